"""How well a farm of emulated workers is used."""
import statistics
from tables_bench import CONE, GLASS, FIRST, LAST, Table, spread, speeds
import collections

HEADER = FIRST + ['tile', 'workers', 'rays', 'rays_per_s', 'best_s', 'elapsed_s', 'least_s', 'greatest_s', 'utilisation', 'mark', 'report'] + LAST
# table, picture, tile, workers (each a group of so many, so many times as fast), the least utilisation that is well, what the report says
Row = collections.namedtuple('Row', 'table picture tile workers mark told')
COUNTS = (1, 2, 4, 8, 16, 32, 48)
REPORT_TILES = {1: '2910 s', 64: '103 s'}
REPORT_WORKERS = {8: '76.5 %', 16: '38.2 %'}
REPORT_ANTIALIASING = {(4, 32): '66 %', (8, 48): '76.6 %'}
WELL = .971 # whatever the tile's side, from 8 on
ROWS = [Row('tiles', CONE, str(side), ((1, 1),), {1: .5}.get(side, WELL if side >= 8 else ''), REPORT_TILES.get(side, ''))
        for side in (1, 2, 4, 8, 16, 32, 64)]
ROWS += [Row('workers', CONE, 'auto', ((n, 1),), {8: .99, 16: .99, 48: .98}.get(n, ''), REPORT_WORKERS.get(n, '')) for n in COUNTS]
ROWS += [Row('antialiasing', CONE._replace(aa=aa), 'auto', ((n, 1),), .99, REPORT_ANTIALIASING.get((aa, n), '')) for aa in (4, 8) for n in (32, 48)]
ROWS += [Row('glass', GLASS, 'auto', ((n, 1),), mark, '') for n, mark in ((48, .97), (256, .93))]
ROWS += [Row('thousand', CONE._replace(size='4096x3072'), 'auto', ((1000, 1),), .95, '')]
ROWS += [Row('mixed', CONE, 'auto', ((4, 1), (4, 2), (4, 4)), '', '')]
ROWS += [Row('fast', CONE, 'auto', ((n, 1000),), '', '') for n in COUNTS]
QUICK = {'tiles': ('1', '32'), 'workers': (1, 8), 'antialiasing': (32,), 'glass': (48,), 'thousand': (1000,), 'fast': (8,)}

def small(rows):
    """Few and tiny ones in their place."""
    chosen = [row for row in rows if row.table == 'mixed' or
              (row.tile if row.table == 'tiles' else row.workers[0][0]) in QUICK[row.table]]
    return list(dict.fromkeys(row._replace(workers=tuple((min(count, 20), speed) for count, speed in row.workers)) for row in chosen))

def measure_row(bench, row):
    picture = bench.small(row.picture)
    rays = bench.truth(picture)[0]
    best = bench.best(rays, row.workers)
    with bench.farm(*row.workers) as farm:
        options = ['-b', farm.broker, '--tile', row.tile]
        bench.have_drawn(picture, options, best)
        elapsed = [bench.seconds(picture, options, best) for _ in range(bench.runs)]
    median, least, greatest = spread(elapsed)
    return bench.line(row.table, picture, tile=row.tile, workers=speeds(row.workers), rays=rays,
                      rays_per_s='%.1f' % (bench.server * row.workers[0][1]), best_s='%.4f' % best, elapsed_s=median, least_s=least,
                      greatest_s=greatest, utilisation='%.4f' % (best / statistics.median(elapsed)),
                      mark='%.3f' % row.mark if row.mark else '', report=row.told)

def measure_table(name):
    def measure(bench):
        rows = [row for row in ROWS if row.table == name]
        for row in dict.fromkeys(small(rows) if bench.quick else rows):
            yield measure_row(bench, row)
    return measure

def missed(line):
    return float(line['utilisation']) < float(line['mark']) if line['mark'] else None

COLUMNS = {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', '--tile': '{tile}', 'workers': '{workers} emulated',
           'rays/s': '{rays_per_s:.1f}', 'best possible, s': '{best_s:.3f}', 'elapsed, s': '{elapsed_s:.3f} ({least_s:.3f} to {greatest_s:.3f})',
           'utilisation': '{utilisation:.1%}', 'at least': '{mark}', 'mark': '{verdict}', 'report': '{report}'}
TITLES = {'tiles': 'Tile sizes, one worker', 'workers': 'Workers, no antialiasing', 'antialiasing': 'Antialiasing',
          'glass': 'A scene of glass', 'thousand': 'A thousand workers', 'mixed': 'Workers of speeds 1 : 2 : 4',
          'fast': 'Workers a thousand times as fast'}
TABLES = {name: Table(title, 'tables', HEADER, measure_table(name), '', COLUMNS, missed) for name, title in TITLES.items()}

def plots(lines):
    """Utilisation by the number of workers."""
    titles = {'workers': 'cone', 'fast': 'cone, machines 1,000 times as fast', 'antialiasing': 'cone, -a %s', 'glass': 'overlapping spheres',
              'thousand': 'cone, 4096x3072'}
    series = {}
    for line in lines:
        if line['table'] in titles:
            title = titles[line['table']].replace('%s', line['aa'])
            series.setdefault(title, []).append((int(line['workers']), 100 * float(line['utilisation'])))
    if any(line['table'] == 'workers' for line in lines):
        series['report of 2002'] = [(8, 76.5), (16, 38.2)]
    if series:
        yield 'tables', ['set logscale x 2', 'set yrange [0:100]', "set xlabel 'workers'", "set ylabel 'utilisation, %'"], [
            (title, pairs, 'with linespoints linewidth 2 pointtype %d' % (4 + i)) for i, (title, pairs) in enumerate(series.items())]
