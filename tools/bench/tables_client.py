"""What fraja-submit takes in and uses while a farm draws for it."""
import json, os, subprocess, sys, time
import harness
from tables_bench import CONE, FIRST, LAST, Table

HEADER = FIRST + ['workers', 'elapsed_s', 'start_cpu_s', 'cpu_s', 'cpu_percent', 'greatest_cpu_percent', 'received_mb', 'mb_per_s',
                  'greatest_mb_per_s', 'mark', 'report'] + LAST
SAMPLES_HEADER = ['time_s', 'cpu_percent', 'bytes_per_s']
COUNT, INTERVAL, MARK_PERCENT = 8, .25, 5

def watch(command, interval):
    """Runs it; (time, processor time, bytes) as they stand at each interval, its processor time in all, and what it tells."""
    begin = time.monotonic()
    samples = [(0, 0, 0)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        sockets = harness.Sockets(child.pid)
        while True:
            time.sleep(max(0, begin + len(samples) * interval - time.monotonic()))
            if os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
                break # and not yet forgotten
            samples.append((time.monotonic() - begin, harness.cpu_seconds(child.pid), sockets.bytes_received()))
        told = child.stdout.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    if status:
        sys.exit('fraja-submit failed')
    return samples, usage.ru_utime + usage.ru_stime, json.loads(told)

def rates(samples):
    """Processor time in percent and bytes a second, between each sample and the next."""
    return [(b[0], 100 * (b[1] - a[1]) / (b[0] - a[0]), (b[2] - a[2]) / (b[0] - a[0])) for a, b in zip(samples, samples[1:])]

def measure(bench):
    picture = bench.small(CONE)
    rays, pixels = bench.truth(picture)
    best = bench.best(rays, ((COUNT, 1),))
    path = bench.scratch + '/client.ppm'
    found = []
    with bench.farm((COUNT, 1)) as farm:
        words = bench.words(picture) + ['-b', farm.broker]
        bench.have_drawn(picture, words[-2:], best)
        for _ in range(bench.runs):
            samples, cpu, told = watch(words + ['--json', '-o', path], .02 if bench.quick else INTERVAL)
            with open(path, 'rb') as file:
                if file.read() != pixels:
                    sys.exit('the farm draws another picture than --local')
            used = told['processor_s']
            found.append((100 * used / told['elapsed_s'], cpu - used, used, told['elapsed_s'], samples))
    percent, start, used, elapsed, samples = sorted(found)[len(found) // 2]
    bench.samples = [dict(zip(SAMPLES_HEADER, ('%.3f' % at, '%.2f' % cpu, '%.0f' % network))) for at, cpu, network in rates(samples)]
    after = [row[1] for row in rates(samples) if row[0] > (0 if bench.quick else 1 + INTERVAL)] # what starts is over by then
    if samples[-1][2] == 0 and not bench.quick: # then it may have ended before anybody looked
        sys.exit('this kernel does not tell what sockets have received')
    silent = max(at for at, _, received in samples if received == 0)
    yield bench.line('client', picture, workers=COUNT, elapsed_s='%.3f' % elapsed, start_cpu_s='%.3f' % start, cpu_s='%.3f' % used,
                     cpu_percent='%.2f' % percent, greatest_cpu_percent='%.1f' % max(after, default=0), received_mb='%.3f' % (samples[-1][2] / 1e6),
                     mb_per_s='%.3f' % (samples[-1][2] / 1e6 / max(samples[-1][0] - silent, 1e-3)),
                     greatest_mb_per_s='%.3f' % max((row[2] / 1e6 for row in rates(samples)), default=0), mark=MARK_PERCENT,
                     report='1 MB/s, 100 %')

def missed(line):
    return float(line['cpu_percent']) > float(line['mark'])

NOTE = """Every %g s: the processor time that `fraja-submit` has used, and the bytes that its TCP sockets have received (payload, as the kernel
counts it for each socket: `tcpi_bytes_received`, what `ss -ti` shows). The average is over the time that the job takes by the broker; what
the process uses to start and to end is left out, the writing of the picture is not. The greatest figures are those of
one interval, that of the processor after the first second. The mark: %g %% of one processor on average. The run with the median of these is
in `client_samples.csv` and the plot.""" % (INTERVAL, MARK_PERCENT)
TABLES = {'client': Table(
    "The client's network and processor", 'client', HEADER, measure, NOTE,
    {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', 'workers': '{workers} emulated', 'elapsed, s': '{elapsed_s:.2f}',
     'processor at start and end, s': '{start_cpu_s:.3f}', 'between, s': '{cpu_s:.3f}', 'processor on average': '{cpu_percent:.2f} %',
     'greatest': '{greatest_cpu_percent:.1f} %', 'received, MB': '{received_mb:.2f}', 'MB/s': '{mb_per_s:.2f}',
     'greatest, MB/s': '{greatest_mb_per_s:.2f}', 'mark': '{verdict}', 'report': '{report}'}, missed)}
SAMPLES = 'client_samples'

def plots(samples):
    """Both by time."""
    columns = [[(float(line['time_s']), float(line[name]) / unit) for line in samples] for name, unit in (('cpu_percent', 1), ('bytes_per_s', 1e6))]
    if samples:
        yield 'client', ["set xlabel 'seconds'", "set ylabel 'processor, %'", "set y2label 'network, MB/s'", 'set yrange [0:105]',
                         'set y2range [0:*]', 'set ytics nomirror', 'set y2tics'], [
            ('processor, %', columns[0], 'axes x1y1 with lines linewidth 2 linecolor rgb "#b03030"'),
            ('received, MB/s', columns[1], 'axes x1y2 with lines linewidth 2 linecolor rgb "#3050b0"'),
            ('report of 2002: processor', [(0, 100), (13, 100)], 'axes x1y1 with lines linecolor rgb "#e0a0a0"'),
            ('report of 2002: network', [(0, 1), (13, 1)], 'axes x1y2 with lines linecolor rgb "#a0b0e0"')]
