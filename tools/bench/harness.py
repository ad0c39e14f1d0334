"""What the benchmarks' scripts share."""
import os, subprocess, sys

def build(target):
    """Goes to the project's root and builds a benchmark there; its program's path."""
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..'))
    for step in (['cmake', '--preset', 'release'],
                 ['cmake', '--build', '--preset', 'release', '--target', 'bench_' + target]):
        subprocess.run(step, check=True, stdout=subprocess.DEVNULL)
    return os.path.abspath('build/release/bench/' + target)

def install(*packages):
    """Debian's."""
    root = [] if os.geteuid() == 0 else ['sudo']
    subprocess.run(root + ['apt-get', 'install', '-y', '--no-install-recommends', *packages], check=True)

def instruction_sets(kernel, scene):
    """Those of this machine that there are marks for; `kernel`: the benchmark's program."""
    sets = [isa for isa in ('x86-64-v3', 'x86-64-v4') if subprocess.run(
        [kernel, '--repeat', '1', '-r', '8x8', scene], env={**os.environ, 'FRAJA_ISA': isa},
        capture_output=True).returncode == 0]
    if not sets:
        sys.exit('this processor has neither AVX2 nor AVX-512')
    return sets

def user_seconds(command, folder, env=None):
    """Of a program that is run in a folder."""
    with open(os.path.join(folder, 'log'), 'w') as log:
        child = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log, env={**os.environ, **(env or {})})
        _, status, usage = os.wait4(child.pid, 0)
    if status:
        sys.exit('%s failed:\n%s' % (command[0], open(os.path.join(folder, 'log')).read()))
    return usage.ru_utime
