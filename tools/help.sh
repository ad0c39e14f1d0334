# Read by the scripts here: prints the comment at the head of the one that was started, where that is asked for.
# shellcheck shell=bash
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
    sed -n '2,/^set/{/^#/s/^# \{0,1\}//p}' "$0"
    exit
fi
