"""What more samples cost, and the report's show-off: drawn by this machine's processors, without a farm."""
import os, statistics
from tables_bench import GLASS, FIRST, LAST, Table

HEADER = FIRST + ['workers', 'rays', 'elapsed_s', 'least_s', 'greatest_s', 'cpu_s', 'factor', 'cpu_factor', 'rays_factor', 'estimate_s',
                  'whole_s', 'report'] + LAST
PICTURE, SAMPLES = GLASS._replace(size='1600x1200'), (1, 2, 4, 8)
SHOW_OFF, LONGEST_S = PICTURE._replace(depth=500, aa=16), 25 * 60
TOLD = 'one machine: 4 days 9 hours (estimated); 92 machines: 2 hours'

def processor():
    """What the system calls it."""
    with open('/proc/cpuinfo') as file:
        names = [line.partition(':')[2].strip() for line in file if line.startswith('model name')]
    return (names or ['a processor'])[0].replace('(R)', '')

def draw(bench, picture):
    """Seconds, processor time and rays; without the start of the process."""
    told, _ = bench.submit(picture, ['--local'], 'price')
    return told['elapsed_s'], told['processor_s'], told['rays']['total']

def line(bench, table, picture, drawn, before=None, **columns):
    """Of what several runs took; `before`: what the picture of half as many samples each way took."""
    elapsed, cpu, rays = zip(*drawn)
    now = statistics.median(elapsed), statistics.median(cpu), rays[0]
    factors = ['%.3f' % (a / b) for a, b in zip(now, before)] if before else [''] * 3
    told = {'workers': '%d threads, %s' % (os.cpu_count(), processor()), 'rays': now[2], 'elapsed_s': '%.3f' % now[0], 'least_s': '%.3f' % min(elapsed),
            'greatest_s': '%.3f' % max(elapsed), 'cpu_s': '%.3f' % now[1], **dict(zip(('factor', 'cpu_factor', 'rays_factor'), factors)),
            'estimate_s': '', 'whole_s': '', 'report': '', **columns}
    return bench.line(table, picture, len(drawn), **told), now

def measure(bench):
    before = None
    for aa in SAMPLES[:2] if bench.quick else SAMPLES:
        picture = bench.small(PICTURE._replace(aa=aa))
        drawn = [draw(bench, picture) for _ in range(bench.runs)]
        told, before = line(bench, 'price', picture, drawn, before, report='factor 3.87' if before else '')
        yield told

def measure_show_off(bench):
    """As large as there is time for, once: -a 2 and 4 say how long it will take."""
    picture = bench.small(SHOW_OFF)
    two, four = (draw(bench, picture._replace(aa=aa))[1] / os.cpu_count() for aa in (2, 4)) # if nobody else works here
    estimate = four * (four / two) ** 2 # -a 4, doubled twice
    parts = 1
    while estimate / parts > LONGEST_S:
        parts *= 4
        width, height = picture.size.split('x')
        picture = picture._replace(size='%dx%d' % (int(width) // 2, int(height) // 2))
    drawn = [draw(bench, picture)]
    yield line(bench, 'showoff', picture, drawn, estimate_s='%.1f' % estimate, whole_s='%.1f' % (parts * drawn[0][0]), report=TOLD)[0]

COLUMNS = {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', 'workers': '{workers}; real (--local)', 'rays': '{rays}',
           'elapsed, s': '{elapsed_s:.2f} ({least_s:.2f} to {greatest_s:.2f})', 'processor, s': '{cpu_s:.2f}'}
BESIDE = 'Where others used the processors, too, the processor time tells what the picture itself took.'
TABLES = {
    'price': Table('The price of samples', 'price', HEADER, measure,
                   'Factors over the row before, of half as many samples each way: of the time, the processor time and the rays. ' + BESIDE,
                   {**COLUMNS, 'factor of the time': '{factor}', 'of the processor time': '{cpu_factor}', 'of the rays': '{rays_factor}',
                    'report': '{report}'}, lambda line: None),
    'showoff': Table('The show-off', 'price', HEADER, measure_show_off,
                     'What -a 2 and 4 say that it takes at 1600x1200; and, where that was more than %d minutes and so a smaller picture was '
                     'drawn, its time by the pixels. ' % (LONGEST_S // 60) + BESIDE,
                     {**COLUMNS, 'estimated before, s': '{estimate_s:.1f}', 'for 1600x1200, s': '{whole_s:.1f}', 'report': '{report}'},
                     lambda line: None)}
