"""The most memory that broker and client have while a large picture is drawn."""
import os, statistics, sys
import harness
from tables_bench import CONE, FIRST, LAST, Table, in_bytes

HEADER = FIRST + ['workers', 'process', 'output', 'state', 'peak_mb', 'least_mb', 'greatest_mb', 'above_mb', 'mark_mb', 'report'] + LAST
PICTURE, THREADS, MARK_MB = CONE._replace(size='1600x1200'), 2, 41
TINY = '64x48'

def measure(bench):
    picture = bench.small(PICTURE)
    words = bench.words(picture)
    pixels = bench.truth(picture)[1]
    idles = [harness.peak_mb(bench.words(picture._replace(size=TINY)) + ['--dry-run', '-o', bench.scratch + '/idle.ppm']) for _ in range(bench.runs)]
    idle = statistics.median(idles)
    def line(process, peaks, output='', state='', above=False, mark='', report='', picture=picture):
        peak = statistics.median(peaks)
        return bench.line('memory', picture, workers='%d threads of one worker' % THREADS, process=process, output=output, state=state,
                          peak_mb='%.1f' % peak, least_mb='%.1f' % min(peaks), greatest_mb='%.1f' % max(peaks),
                          above_mb='%.1f' % (peak - idle) if above else '', mark_mb=mark, report=report)
    yield line('fraja-submit --dry-run', idles, picture=picture._replace(size=TINY))
    for state in 'none', 'DIR':
        brokers, tiny, clients = [], [], {'ppm': [], 'png': []}
        for run in range(bench.runs):
            folder = os.path.join(bench.scratch, 'state%d' % run)
            with bench.farm(state='none' if state == 'none' else folder) as farm:
                farm.start_worker(THREADS)
                farm.await_workers(1)
                tiny.append(harness.peak_mb(bench.words(picture._replace(size=TINY)) + ['-b', farm.broker, '-o', bench.scratch + '/tiny.ppm']))
                output = bench.scratch + '/farm.ppm'
                clients['ppm'].append(harness.peak_mb(words + ['-b', farm.broker, '-o', output]))
                brokers.append(harness.peak_resident_mb(farm.processes[0].pid))
                with open(output, 'rb') as file:
                    if file.read() != pixels:
                        sys.exit('the farm draws another picture than --local')
                clients['png'].append(harness.peak_mb(words + ['-b', farm.broker, '-o', bench.scratch + '/farm.png']))
        yield line('fraja-broker', brokers, state=state, mark=MARK_MB)
        if state == 'none':
            yield line('fraja-submit', tiny, output='ppm', state=state, above=True, picture=picture._replace(size=TINY))
        for output, peaks in clients.items():
            yield line('fraja-submit', peaks, output=output, state=state, above=True, mark=MARK_MB, report='41 MB')

def missed(line):
    return float(line['above_mb'] or line['peak_mb']) > float(line['mark_mb']) if line['mark_mb'] else None

NOTE = """The greatest resident memory (VmHWM) of each process, in units of 10^6 bytes; the picture is drawn by a real worker. The broker's
is held against %d MB as it is; the client's by how much it is above that of `fraja-submit --dry-run`, a process that has loaded the
same libraries, OpenImageIO among them, and read the scene. With `--state none` the broker keeps the pixels of every job that is not
forgotten: here of this one, %.1f MB.""" % (MARK_MB, in_bytes(PICTURE.size) / 1e6)
TABLES = {'memory': Table(
    'Memory', 'memory', HEADER, measure, NOTE,
    {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', 'workers': '{workers}, real', 'process': '{process}', '-o': '{output}',
     '--state of the broker': '{state}', 'peak, MB': '{peak_mb:.1f} ({least_mb:.1f} to {greatest_mb:.1f})',
     'above --dry-run, MB': '{above_mb}', 'mark': '{verdict}', 'report': '{report}'}, missed)}
