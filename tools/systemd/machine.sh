# Read by tools/try_packages: boots the Debian in $root in a container, with its systemd and a network of its own.
# shellcheck shell=bash disable=SC2154 # root, inside and fail are the reader's

# Where cgroups are of the first version, nspawn leaves their limits to nobody; the container gets a group to divide.
memory_group=
if own=$(grep --only-matching --perl-regexp ':memory:\K.*' /proc/self/cgroup); then
    memory_group=/sys/fs/cgroup/memory$own/fraja-try
fi

machine_on() {
    inside apt-get --quiet=2 --yes -o Dpkg::Use-Pty=0 --no-install-recommends install systemd-sysv dbus >/dev/null
    inside apt-mark auto systemd-sysv dbus >/dev/null # so that the next Debian has nothing else, again
    rm -rf "$root"/var/log/journal/* # the last time's
    (
        if [[ -n $memory_group ]]; then
            mkdir --parents "$memory_group"
            echo "$BASHPID" >"$memory_group"/cgroup.procs
        fi
        exec systemd-nspawn --quiet --directory="$root" --machine=fraja-try --register=no --keep-unit --private-network --resolv-conf=off \
            --timezone=off --link-journal=no --rlimit=RLIMIT_NOFILE=1024:524288 --console=pipe --boot
    ) </dev/null >"$root"/root/boot.log 2>&1 &
    machine=$!
    for _ in $(seq 300); do
        init=$(pgrep --parent "$machine" | head -1 || true)
        if [[ -n $init ]] && in_machine systemctl is-system-running --wait 2>/dev/null | grep --quiet 'running\|degraded'; then
            if [[ -n $memory_group ]]; then
                in_machine mount -o remount,bind,rw /sys/fs/cgroup/memory
                in_machine systemctl daemon-reexec
            fi
            return
        fi
        kill -0 "$machine" 2>/dev/null || break
        sleep 0.1
    done
    cat "$root"/root/boot.log >&2
    fail "it does not boot"
}

in_machine() { nsenter --target "$init" --all env --ignore-environment PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 "$@"; }

machine_off() {
    [[ -n ${machine:-} ]] || return 0
    kill -TERM "$machine" 2>/dev/null || true # nspawn tells the systemd inside
    wait "$machine" || true
    machine=
    rm -f "$root"/root/boot.log
    [[ -z $memory_group ]] || find "$memory_group" -depth -type d -exec rmdir {} \; 2>/dev/null || true
}
