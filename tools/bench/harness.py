"""What the benchmarks' scripts share."""
import os, subprocess, sys, time

def build_target(target):
    """Goes to the project's root and builds it there."""
    os.chdir(os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..'))
    for step in (['cmake', '--preset', 'release'], ['cmake', '--build', '--preset', 'release', '--target', target]):
        subprocess.run(step, check=True, stdout=subprocess.DEVNULL)

def build(benchmark):
    """Likewise, a program of tools/bench; its path."""
    build_target('bench_' + benchmark)
    return os.path.abspath('build/release/bench/' + benchmark)

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

class Farm:
    """A broker and workers of one thread each, on ports that the system picks."""
    def __init__(self, programs, workers, folder):
        self.programs = programs
        self.log = open(os.path.join(folder, 'farm.log'), 'w')
        self.processes = [subprocess.Popen([programs + '/fraja-broker', '--bind', 'tcp://127.0.0.1:0', '--publish', 'tcp://127.0.0.1:0',
                                            '--state', 'none'], stdout=subprocess.PIPE, stderr=self.log, text=True)]
        words = self.processes[0].stdout.readline().split() # listening ENDPOINT stream ENDPOINT
        if len(words) < 2:
            sys.exit('the broker did not come up')
        self.broker = words[1]
        for i in range(workers):
            self.processes.append(subprocess.Popen([programs + '/fraja-worker', '-b', self.broker, '-j', '1', '--name', 'worker-%d' % i],
                                                   stdout=self.log, stderr=self.log))
    def emulate(self, groups, count):
        """Adds one process that emulates so many workers, each group as COUNT@SPEED, and waits until all are here."""
        options = [word for group in groups for word in ('--emulate', group)]
        self.processes.append(subprocess.Popen([self.programs + '/fraja-worker', '-b', self.broker, '--name', 'emulated', *options],
                                               stdout=self.log, stderr=self.log))
        end = time.monotonic() + 60
        while open(self.log.name).read().count(' is here: ') < count:
            if time.monotonic() > end:
                sys.exit('the workers did not come')
            time.sleep(.05)
    def __enter__(self):
        return self
    def __exit__(self, *_):
        for processes in (self.processes[1:], self.processes[:1]): # workers say goodbye to a broker that is there
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()
        self.log.close()
