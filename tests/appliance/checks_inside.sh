#!/bin/bash
# Level 5, inside the virtual appliance (tools/test-appliance): one line "ok|FAILED <tab> check <tab> what was seen" per check to
# /dev/ttyS1. Times are of an emulated processor, 10 to 20 times slower than the appliance's: behaviour is judged, not speed.
exec 3>/dev/ttyS1
journalctl -b -f -u teres --no-pager >/dev/ttyS0 &
bus=/run/bus-lines   # every message of interest as `teres spy --lines` tells it, with its monotonic time
config=/etc/teres/teres.toml
tell() { printf '%s\t%s\t%s\n' "$1" "$2" "$3" >&3; echo "$1: $2: $3"; }
check() { # NAME SEEN COMMAND...: the command's exit code decides
    local name=$1 seen=$2; shift 2
    if "$@" >/run/check.log 2>&1; then tell ok "$name" "$seen"; else tell FAILED "$name" "$seen $(tail -3 /run/check.log | tr '\n\t' '  ')"; fi
}
uptime_s() { cut -d' ' -f1 /proc/uptime; }
since() { awk -v a="$1" -v b="${2:-$(uptime_s)}" 'BEGIN { printf "%.1f s", b - a }'; }
mark() { at=$(uptime_s); lines=$(wc -l <$bus); }
comes() { # SECONDS PATTERN: a message like this comes after the mark; its time in $came
    local end=$((SECONDS + $1))
    while [ $SECONDS -lt $end ]; do
        came=$(tail -n +$((lines + 1)) $bus | grep -m1 -E "$2" | cut -d' ' -f1) && [ -n "$came" ] && return 0
        sleep 0.5
    done
    came=; return 1
}
expect() { # NAME SECONDS PATTERN
    if comes "$2" "$3"; then tell ok "$1" "after $(since "$at" "$came")"; else
        tell FAILED "$1" "not within $2 s; last: $(tail -n +$((lines + 1)) $bus | grep -v INFO | tail -2 | cut -c1-400 | tr '\n\t' '  ')"; fi
}
wait_for() { local end=$((SECONDS + $1)); while [ $SECONDS -lt $end ]; do "${@:2}" && return 0; sleep 0.5; done; return 1; }
active() { [ "$(systemctl is-active teres.service)" = active ]; }
pid() { systemctl show -P MainPID teres.service; }
other_than() { local now; now=$(pid); [ "$now" != "$1" ] && [ "$now" != 0 ] && active; }
health() { echo "DEVICE_HEALTH .*device=$1 .*state=$2"; }
received() { grep -E "device=$1 " $bus | tail -1 | sed 's/.* received=\([0-9]*\).*/\1/'; }
configure() { # DRIVERS, settings of the camera on stdin
    printf '[service]\ndrivers = [%s]\nplugins = []\nbus_url = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=16777216"\n[camera]\nstale_after_s = 1.0\n' "$1" >$config
    cat >>$config; systemctl restart teres
}

tell note "checks begin" "$(uptime_s) s after power-on"

# 1. The installed package starts by itself.
wait_for 240 active
teres spy --lines --channels 'DEVICE_HEALTH|PEDAL|CAMERA_.*_INFO|BOUNDARY_ESTIMATE|HEALTH' >$bus 2>/run/spy.log &
if ! grep -q teres.checks=devices /proc/cmdline; then
check "autostart of the installed package" "active $(systemctl show -P ActiveEnterTimestampMonotonic teres.service | awk '{ printf "%.0f s", $1 / 1e6 }') after power-on, $(uname -r)" active
check "route, firewall before the service" "$(systemctl is-active teres-multicast teres-firewall | tr '\n' ' ')" systemctl is-active teres-multicast teres-firewall
check "kernel settings of the package" "rmem_max $(sysctl -n net.core.rmem_max), ipfrag_time $(sysctl -n net.ipv4.ipfrag_time)" \
    test "$(sysctl -n net.core.rmem_max) $(sysctl -n net.ipv4.ipfrag_time)" = "33554432 2"
check "size limit of the journal" "$(systemd-analyze cat-config systemd/journald.conf | grep -E '^SystemMaxUse')" grep -rq SystemMaxUse=500M /usr/lib/systemd/journald.conf.d
check "teres doctor" "$(teres doctor --config $config | grep -c '^ok') lines ok" teres doctor --config $config
mark
expect "the bundled case runs: estimates on the bus" 120 'BOUNDARY_ESTIMATE .*num_parameters=[1-9]'

# 2. Crash, kill, hang.
for fault in SEGV KILL STOP; do
    before=$(pid); at=$(uptime_s); kill -$fault "$before"
    if wait_for 90 other_than "$before"; then tell ok "service after SIG$fault" "back after $(since "$at")"; else tell FAILED "service after SIG$fault" "not back in 90 s"; fi
done

# 3. The network: a laptop in a namespace of its own sends to the bus's port.
ip netns add laptop; ip link add appliance0 type veth peer name laptop0 netns laptop
ip addr add 10.77.0.1/24 dev appliance0; ip link set appliance0 up
ip -n laptop addr add 10.77.0.2/24 dev laptop0; ip -n laptop link set laptop0 up
before=$(pid)
# A fragment of a long message whose offset wraps (it kills liblcm 1.3.1), then noise.
for _ in 1 2 3; do ip netns exec laptop bash -c 'printf "LC03\0\0\0\1\0\0\1\0\377\377\377\360\0\1\0\2%0200d" 0 >/dev/udp/10.77.0.1/7667; head -c 900 /dev/urandom >/dev/udp/10.77.0.1/7667'; done
sleep 1
dropped=$(nft list table inet teres | sed -n 's/.*packets \([0-9]*\).*/\1/p')
check "packets from the network to the bus" "$dropped of 6 dropped, service pid $before -> $(pid)" test "$dropped" = 6 -a "$before" = "$(pid)"

# 4. Confinement by the real kernel: a root shell that is put into the service's cgroup.
confined() { (echo $BASHPID >/sys/fs/cgroup/system.slice/teres.service/cgroup.procs && exec "$@"); }
only_its_devices() { head -c1 /dev/vda >/dev/null && confined cat /dev/null && ! confined head -c1 /dev/vda; }
check "access to the disk device" "$(confined head -c1 /dev/vda 2>&1 | tail -1)" only_its_devices
ip netns exec laptop bash -c 'exec 4<>/dev/udp/10.77.0.1/9; sleep 600' &
received_by_laptop() { ip netns exec laptop cat /sys/class/net/laptop0/statistics/rx_packets; }
send_to_laptop() { "$@" bash -c 'for _ in 1 2 3 4 5; do echo x >/dev/udp/10.77.0.2/9; done' 2>/dev/null; sleep 1; }
send_to_laptop; before=$(received_by_laptop); send_to_laptop; outside=$(($(received_by_laptop) - before))
before=$(received_by_laptop); send_to_laptop confined; inside=$(($(received_by_laptop) - before))
check "the service cannot send to the network" "$inside of 5 packets from its cgroup, $outside from outside" test "$inside" -lt 3 -a "$outside" -ge 5

fi

# 5. Simulated RealSense D435 on USB/IP, kernel driver uvcvideo; footswitch on dummy_hcd, kernel driver usbhid.
modprobe -a vhci_hcd uvcvideo dummy_hcd libcomposite usb_f_hid
mount -t configfs none /sys/kernel/config 2>/dev/null
gadget=/sys/kernel/config/usb_gadget/pedal
mkdir -p $gadget/strings/0x409 $gadget/configs/c.1 $gadget/functions/hid.usb0
echo 0x05f3 >$gadget/idVendor; echo 0x00ff >$gadget/idProduct; echo "VEC footswitch (simulated)" >$gadget/strings/0x409/product
echo 0 >$gadget/functions/hid.usb0/protocol; echo 0 >$gadget/functions/hid.usb0/subclass; echo 2 >$gadget/functions/hid.usb0/report_length
# Report: 3 buttons, 13 bits of padding.
printf '\x05\x01\x09\x04\xa1\x01\x05\x09\x19\x01\x29\x03\x15\x00\x25\x01\x75\x01\x95\x03\x81\x02\x75\x0d\x95\x01\x81\x03\xc0' >$gadget/functions/hid.usb0/report_desc
ln -s $gadget/functions/hid.usb0 $gadget/configs/c.1/

mark
configure '"camera", "pedal"' <<'TOML'
color_device = "123456789abc"
color_width_px = 320
color_height_px = 240
color_rate_hz = 15
depth_device = "842512070299"
depth_width_px = 320
depth_height_px = 240
depth_rate_hz = 15
TOML
expect "no camera, no footswitch: said, service ready" 30 "$(health camera.depth absent)"
check "service is ready without its devices" "$(systemctl is-active teres)" wait_for 10 active
simulated_camera >/run/camera.log 2>&1 &
camera=$!
mark
expect "camera plugged in: depth, found by the printed serial number" 60 "$(health camera.depth streaming)"
expect "colour, found by the USB serial number" 30 "$(health camera.color streaming)"
expect "calibration from the device: intrinsics, depth unit, baseline" 30 'CAMERA_DEPTH_INFO .*baseline_m=0.05 .*depth_unit_m=0.0005 .*fx_px=193 '
expect "temperature from the extension unit" 30 "$(health camera.depth streaming) .*temperature_c=41"
sleep 5
check "kernel drivers are the real ones" "$(basename "$(readlink /sys/class/video4linux/video0/device/driver)"), frames: depth $(received camera.depth), colour $(received camera.color)" \
    test "$(basename "$(readlink /sys/class/video4linux/video0/device/driver)")" = uvcvideo
mark; kill -9 $camera
expect "unplugged in mid-stream" 30 "$(health camera.depth absent)"
simulated_camera >/run/camera.log 2>&1 &
camera=$!
mark
expect "plugged in again: depth" 60 "$(health camera.depth streaming)"
expect "plugged in again: colour" 60 "$(health camera.color streaming)"
mark; kill -USR1 $camera
expect "stuck camera: stale" 30 "$(health camera.depth stale)"
mark
expect "stuck camera: recovering" 30 "$(health camera.depth recovering)"
mark
expect "streams again after the staged recovery" 90 "$(health camera.depth streaming)"
check "recovery went as far as the hardware reset" "attached $(grep -c attached /run/camera.log) times" test "$(grep -c attached /run/camera.log)" -ge 2
kill -9 $camera; sleep 2
simulated_camera --usb2 >/run/camera.log 2>&1 &
camera=$!
mark
expect "the same camera on a USB 2 port: said" 60 'DEVICE_HEALTH .*detail=on a USB 2 link .480 Mbit/s.*device=camera.depth .*state=streaming'

mark; ls /sys/class/udc >/run/udc; echo "$(grep -m1 dummy /run/udc)" >$gadget/UDC
expect "footswitch plugged in" 30 "$(health pedal streaming)"
sleep 2
mark; printf '\x01\x00' >/dev/hidg0
expect "pedal pressed" 20 'PEDAL action=record .*down=(1|true) .*pedal=left'
mark; echo "" >$gadget/UDC
expect "footswitch unplugged while pressed: pedal goes up" 20 'PEDAL action=record .*down=(0|false) .*pedal=left'
expect "footswitch absent" 20 "$(health pedal absent)"
mark; echo "$(grep -m1 dummy /run/udc)" >$gadget/UDC
expect "footswitch plugged in again" 30 "$(health pedal streaming)"
kill -9 $camera

# 6. A grabber that is no USB device (vivid): chosen by name; a size it does not have is refused although the driver "accepts" it.
modprobe vivid n_devs=1 node_types=0x1 input_types=0x0
grabber() { # STREAM, FORMAT, WIDTH
    printf '%s_device = "vivid-000-vid-cap"\n%s_format = "%s"\n%s_width_px = %s\n' "$1" "$1" "$2" "$1" "$3" | configure '"camera"'
}
mark; grabber color YUYV 640
expect "grabber by its name (vivid): streams" 60 "$(health camera.color streaming)"
sleep 4; mark; sleep 4
check "grabber: frames" "$(received camera.color) frames, $(tail -n +$((lines + 1)) $bus | grep -m1 -o 'rate_hz=[0-9.]*')" test "$(received camera.color)" -gt 10
mark; grabber color YUYV 650
expect "another size than asked for: refused, both named" 60 'DEVICE_HEALTH .*detail=.*YUYV 650x480 not offered; the driver gives YUYV [0-9]+x[0-9]+'
mark; grabber depth Z16 640
expect "depth of a grabber: refused, named" 60 'DEVICE_HEALTH .*detail=camera vivid-000-vid-cap offers no Z16'
v4l2-ctl -d /dev/video0 --set-fmt-video=width=640,height=480,pixelformat='Z16 ' >/dev/null 2>&1
tell note "what the driver itself answers to Z16" "$(v4l2-ctl -d /dev/video0 --get-fmt-video | sed -n "s/.*Pixel Format *: //p"), not an error"
check "service after all this" "$(systemctl show -P NRestarts teres) automatic restarts, $(systemctl is-active teres)" active
cat /run/spy.log >/dev/ttyS0
tell done "" "uptime $(uptime_s) s"
