#!/usr/bin/env bash
# Level 4: the package, installed into a throw-away copy of this machine's root (overlay), boots under systemd (nspawn). The
# service must be ready, and back within the limit after a kill, a crash and a hang. Usage: boot_test.sh TERES.deb | BUILD_FOLDER
# Needs root, overlayfs and systemd-nspawn; says so and ends with 77 where one is missing.
set -euo pipefail
given=$(readlink -f "$1")
limit_ms=${TERES_BACK_WITHIN_MS:-2000}
missing() { echo "SKIPPED LOUDLY: $*"; exit 77; }
[ "$(id -u)" = 0 ] || missing "not root"
command -v systemd-nspawn >/dev/null || missing "systemd-nspawn is not installed (apt: systemd-container)"
work=$(mktemp -d)
cleanup() {
    umount -l "$work/disk/root" 2>/dev/null || true
    umount -l "$work/disk" 2>/dev/null || true
    rm -rf "$work"
}
trap cleanup EXIT
mkdir "$work/disk" "$work/out"
deb=$given
if [ -d "$given" ]; then
    (cd "$given" && cpack -B "$work/package" >"$work/cpack" 2>&1) || { cat "$work/cpack"; exit 1; }
    deb=$(ls "$work"/package/teres_*.deb)
fi
mount -t tmpfs tmpfs "$work/disk" || missing "no tmpfs"
mkdir "$work/disk/up" "$work/disk/work" "$work/disk/root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$work/disk/up,workdir=$work/disk/work" "$work/disk/root" || missing "no overlayfs"
root=$work/disk/root
# Nothing of this machine's own services starts: only what the target below wants.
rm -rf "$root/run" "$root/etc/systemd/system" && mkdir -p "$root/run" "$root/etc/systemd/system"
: >"$root/etc/machine-id"
cp "$deb" "$root/tmp/teres.deb"
chroot "$root" dpkg -i /tmp/teres.deb >"$work/out/dpkg" 2>&1 || { cat "$work/out/dpkg"; exit 1; }

cat >"$root/etc/systemd/system/teres-test.target" <<'UNIT'
[Unit]
Wants=basic.target dbus.service teres.service teres-test.service
UNIT
cat >"$root/etc/systemd/system/teres-test.service" <<'UNIT'
[Service]
Type=oneshot
ExecStart=/bin/bash /out/inside.sh
ExecStopPost=/bin/systemctl --no-block --force --force poweroff
TimeoutStartSec=100
UNIT
cat >"$work/out/inside.sh" <<'INSIDE'
exec >/out/said 2>&1
now() { echo $(($(date +%s%N) / 1000000)); }
pid() { systemctl show -P MainPID teres.service; }
active() { [ "$(systemctl is-active teres.service)" = active ]; }
wait_for_other() { # than the pid $1; 20 s at most
    for _ in $(seq 1000); do
        sleep 0.02
        other=$(pid)
        [ "$other" != "$1" ] && [ "$other" != 0 ] && active && return 0
    done
    return 1
}
for _ in $(seq 1000); do active && break; sleep 0.02; done
active && echo "ready yes" || echo "ready no"
systemctl is-active teres-multicast.service teres-firewall.service | tr '\n' ' ' | sed 's/^/units /'; echo
for fault in KILL SEGV STOP; do
    sleep 1
    before=$(pid); begin=$(now)
    kill -$fault "$before"
    if wait_for_other "$before"; then echo "$fault back_ms $(($(now) - begin))"; else echo "$fault back_ms -1"; fi
done
echo "restarts $(systemctl show -P NRestarts teres.service)"
echo "result $(systemctl show -P Result teres.service)"
/usr/bin/teres doctor --config /etc/teres/teres.toml
journalctl -u teres --no-pager -n 40
INSIDE

timeout -k 5 180 systemd-nspawn -q -D "$root" --register=no --keep-unit --private-network -M "teres-test-$$" \
    --bind="$work/out:/out" --console=pipe --boot systemd.unit=teres-test.target >"$work/console" 2>&1 || true
[ -f "$work/out/said" ] || { echo "FAILED: did not boot"; tail -20 "$work/console"; exit 1; }
cat "$work/out/said"
status=0
grep -q '^ready yes' "$work/out/said" || { echo "FAILED: not ready"; status=1; }
for fault in KILL SEGV STOP; do
    took=$(sed -n "s/^$fault back_ms //p" "$work/out/said")
    [ -n "$took" ] && [ "$took" -ge 0 ] && [ "$took" -le "$limit_ms" ] || { echo "FAILED: $fault: back after '$took' ms, limit $limit_ms"; status=1; }
done
exit $status
