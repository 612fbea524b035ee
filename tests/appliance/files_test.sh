#!/usr/bin/env bash
# Level 4 without a boot: what systemd, nft and udev say of the shipped files. Usage: files_test.sh SOURCE PROGRAM
set -euo pipefail
source=$(readlink -f "$1") program=$(readlink -f "$2")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
status=0
fail() { echo "FAILED: $*"; status=1; }
skip() { echo "SKIPPED LOUDLY: $*"; }

if command -v systemd-analyze >/dev/null; then
    for unit in teres teres-multicast teres-firewall teres-bridge@ teres-record teres-diagnose; do
        # The program and the rules where they are now, not where the package puts them.
        sed -e "s#/usr/bin/teres#$program#" -e "s#/usr/sbin/nft#$(command -v nft || echo /bin/true)#" \
            "$source/config/appliance/$unit.service" >"$work/$unit.service"
        # Unknown keys are only told on stderr, with exit code 0.
        said=$(systemd-analyze verify --man=no "$work/$unit.service" 2>&1) || fail "verify $unit"
        [ -z "$said" ] || fail "verify $unit: $said"
    done
    for unit in teres teres-bridge@ teres-record teres-diagnose; do
        systemd-analyze security --offline=true --threshold=20 "$work/$unit.service" >"$work/said" ||
            fail "exposure of $unit: $(tail -1 "$work/said")"
        tail -1 "$work/said"
    done
    # It can be told apart: a misspelt key and a service without hardening are found.
    sed 's/NoNewPrivileges/NoNewPriv/' "$work/teres.service" >"$work/bad.service"
    [ -n "$(systemd-analyze verify --man=no "$work/bad.service" 2>&1)" ] || fail "a misspelt key passes"
    printf '[Service]\nExecStart=/bin/true\n' >"$work/bare.service"
    systemd-analyze security --offline=true --threshold=20 "$work/bare.service" >/dev/null && fail "a bare unit passes"
else
    skip "systemd-analyze is not installed"
fi

if command -v nft >/dev/null && unshare -rn true 2>/dev/null; then
    # Twice: loading it again must not double the rules.
    unshare -rn sh -ec "nft -f '$source/config/appliance/teres.nft'; nft -f '$source/config/appliance/teres.nft'; nft list table inet teres" >"$work/rules" ||
        fail "nft refuses the rules"
    [ "$(grep -c 'udp dport 7667' "$work/rules")" = 1 ] || fail "rules: $(cat "$work/rules")"
else
    skip "nft or network namespaces are not available"
fi

# The unit's IPAddressAllow= looks at the source address: without `src` it is that of another interface, or none.
if command -v ip >/dev/null && unshare -rn true 2>/dev/null; then
    sed -n 's/^ExecStart=//p' "$source/config/appliance/teres-multicast.service" >"$work/route.sh"
    unshare -rn sh -ec "ip link add other type veth peer name end; ip addr add 10.77.0.1/24 dev other; ip link set other up; . '$work/route.sh'
        ip route get 239.255.76.67" >"$work/route" || fail "the route of teres-multicast.service"
    grep -q 'dev lo src 127.0.0.1' "$work/route" || fail "packets of the bus do not come from 127.0.0.1: $(head -1 "$work/route")"
else
    skip "ip or network namespaces are not available"
fi

for script in postinst prerm postrm; do
    sh -n "$source/config/appliance/$script" || fail "$script"
    [ -x "$source/config/appliance/$script" ] || fail "$script is not executable"
done
"$program" doctor --config "$source/config/appliance/teres.toml" --set service.case="$source/config/cases/demo" \
    --set service.bus_url=memq:// >"$work/doctor" || fail "doctor: $(grep -A1 '^fail' "$work/doctor")"
exit $status
