"""What the benchmarks' scripts share."""
import os, socket, struct, subprocess, sys, time

def answer_help(text):
    """Ends the program where that is all that is wanted."""
    if {'-h', '--help'} & set(sys.argv[1:]):
        print(text)
        sys.exit()

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
    """A broker and workers of one thread each, on ports that the system picks; `state`: the broker's --state, `options`: more of them."""
    def __init__(self, programs, workers, folder, state='none', options=()):
        self.programs, self.state, self.options = programs, state, list(options)
        self.log = open(os.path.join(folder, 'farm.log'), 'w')
        self.reader, self.told, self.seen = open(self.log.name), '', 0
        self.processes = [self.start_broker('tcp://127.0.0.1:0', 'tcp://127.0.0.1:0')]
        for _ in range(workers):
            self.start_worker(1)
    def start_broker(self, bind, publish):
        broker = subprocess.Popen([self.programs + '/fraja-broker', '--bind', bind, '--publish', publish, '--state', self.state, *self.options],
                                  stdout=subprocess.PIPE, stderr=self.log, text=True)
        words = broker.stdout.readline().split() # listening ENDPOINT stream ENDPOINT
        if len(words) < 4:
            sys.exit('the broker did not come up')
        self.broker, self.stream = words[1], words[3]
        return broker
    def start_worker(self, threads):
        name = 'worker-%d' % (len(self.processes) - 1)
        self.processes.append(subprocess.Popen([self.programs + '/fraja-worker', '-b', self.broker, '-j', str(threads), '--name', name],
                                               stdout=self.log, stderr=self.log))
    def restart_broker(self):
        """Kills it, and starts another one in its place."""
        self.processes[0].kill()
        self.processes[0].wait()
        self.processes[0] = self.start_broker(self.broker, self.stream)
    def workers_seen(self):
        """How many workers have come so far, but for those whose broker has seen them leave."""
        self.told += self.reader.read()
        whole, _, self.told = self.told.rpartition('\n')
        self.seen += whole.count(' is here: ') - whole.count(' is gone (')
        return self.seen
    def await_workers(self, count, seconds=60):
        """Until so many have."""
        end = time.monotonic() + seconds
        while self.workers_seen() < count:
            if time.monotonic() > end:
                sys.exit('the workers did not come: %d of %d' % (self.workers_seen(), count))
            time.sleep(.02)
    def emulate(self, groups, count):
        """Adds one process that emulates so many workers, each group as COUNT@SPEED, and waits until all are here."""
        options = [word for group in groups for word in ('--emulate', group)]
        self.processes.append(subprocess.Popen([self.programs + '/fraja-worker', '-b', self.broker, '--name', 'emulated', *options],
                                               stdout=self.log, stderr=self.log))
        self.await_workers(count)
    def listen(self, groups, count):
        """The same, but the workers wait to be called; their endpoints."""
        options = [word for group in groups for word in ('--emulate', group)]
        worker = subprocess.Popen([self.programs + '/fraja-worker', '--listen', 'tcp://127.0.0.1:0', '--name', 'listening', *options],
                                  stdout=subprocess.PIPE, stderr=self.log, text=True)
        self.processes.append(worker)
        lines = [worker.stdout.readline().split() for _ in range(count)] # listening ENDPOINT
        if not all(len(words) == 2 for words in lines):
            sys.exit('the workers that listen did not come up')
        return [words[1] for words in lines]
    def __enter__(self):
        return self
    def __exit__(self, *_):
        for processes in (self.processes[1:], self.processes[:1]): # workers say goodbye to a broker that is there
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()
                if process.stdout:
                    process.stdout.close()
        self.log.close()
        self.reader.close()

def cpu_seconds(pid):
    """That a process has used so far, in all its threads."""
    return time.clock_gettime(~pid << 3 | 2) # as clock_getcpuclockid() makes it

def resident_mb(pid):
    with open('/proc/%d/statm' % pid) as file:
        return int(file.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6

def peak_resident_mb(pid):
    """The most that a process has had so far."""
    with open('/proc/%d/status' % pid) as file:
        return next(int(line.split()[1]) for line in file if line.startswith('VmHWM:')) * 1024 / 1e6

def peak_mb(command):
    """The most that a program has from its start to its end; it must be content."""
    # A process counts what it had before it became the program, so one starts it that has next to nothing.
    start = ('import os, sys; child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=[(os.POSIX_SPAWN_OPEN, 1, '
             '"/dev/null", os.O_WRONLY, 0)]); _, status, usage = os.wait4(child, 0); print(status, usage.ru_maxrss)')
    told = subprocess.run([sys.executable, '-I', '-S', '-c', start, *command], stdout=subprocess.PIPE, text=True, check=True).stdout
    status, peak_kib = map(int, told.split())
    if status:
        sys.exit('%s failed' % ' '.join(command))
    return peak_kib * 1024 / 1e6

class Sockets:
    """What has come in through a process's TCP sockets, in bytes of payload, as the kernel counts it for each of them."""
    def __init__(self, pid):
        self.pid, self.received = pid, {}
        self.diagnosis = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 4) # NETLINK_SOCK_DIAG
    @staticmethod
    def can_be_asked():
        """Some sandboxes have no sock_diag."""
        try:
            socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 4).close()
            return True
        except OSError:
            return False
    def bytes_received(self):
        """So far, by those, too, that are closed now (as far as they had come when this was last asked)."""
        own = self.inodes()
        for family in socket.AF_INET, socket.AF_INET6:
            self.received.update((inode, count) for inode, count in self.every_socket(family) if inode in own)
        return sum(self.received.values())
    def inodes(self):
        """Of all its sockets; none when it has ended."""
        folder, inodes = '/proc/%d/fd' % self.pid, set()
        try:
            names = os.listdir(folder)
        except OSError:
            return inodes
        for name in names:
            try:
                kind, _, inode = os.readlink(os.path.join(folder, name)).partition(':')
            except OSError: # closed in between
                continue
            if kind == 'socket':
                inodes.add(int(inode.strip('[]')))
        return inodes
    def every_socket(self, family):
        """Of the machine's TCP sockets inode and bytes received; sock_diag(7) has the structures."""
        wish = struct.pack('=BBBxI48x', family, socket.IPPROTO_TCP, 1 << 1, 0xffffffff) # with tcp_info, in any state
        self.diagnosis.send(struct.pack('=IHHII', 16 + len(wish), 20, 0x301, 0, 0) + wish) # SOCK_DIAG_BY_FAMILY; request, dump
        while True:
            told, at = self.diagnosis.recv(1 << 18), 0
            while at < len(told):
                size, kind = struct.unpack_from('=IH', told, at)
                if kind != 20: # NLMSG_DONE, or an error
                    return
                inode, attribute = struct.unpack_from('=I', told, at + 16 + 68)[0], at + 16 + 72
                while attribute < at + size:
                    length, name = struct.unpack_from('=HH', told, attribute)
                    if name == 2 and length >= 4 + 136: # INET_DIAG_INFO
                        yield inode, struct.unpack_from('=Q', told, attribute + 4 + 128)[0] # tcpi_bytes_received
                    attribute += max(length + 3 & ~3, 4)
                at += size + 3 & ~3
