"""Static connections without a broker's process (the report's Straja) against a broker."""
import statistics
from tables_bench import CONE, FIRST, LAST, Table

HEADER = FIRST + ['workers', 'rays_per_s', 'best_s', 'broker_s', 'direct_s', 'ratio', 'least_ratio', 'greatest_ratio', 'mark', 'report'] + LAST
COUNTS, MARK = (8, 16, 48), 1.01

def measure_pairs(bench, count, picture, pairs):
    best = bench.best(bench.truth(picture)[0], ((count, 1),))
    elapsed = []
    with bench.farm((count, 1)) as farm:
        ways = [['-b', farm.broker], ['--direct', ','.join(farm.listen(['%d@%.6f' % (count, bench.server)], count))]]
        for way in ways:
            bench.submit(picture, way, 'farm') # has it drawn
        for _ in range(pairs):
            pair = {way[0]: bench.seconds(picture, way, best) for way in ways}
            elapsed.append((pair['-b'], pair['--direct']))
            ways.reverse() # nobody always goes first
    ratios = [broker / direct for broker, direct in elapsed]
    broker, direct = ('%.4f' % statistics.median(column) for column in zip(*elapsed))
    return bench.line('direct', picture, pairs, workers=count, rays_per_s='%.1f' % bench.server, best_s='%.4f' % best, broker_s=broker,
                      direct_s=direct, ratio='%.5f' % statistics.median(ratios), least_ratio='%.5f' % min(ratios),
                      greatest_ratio='%.5f' % max(ratios), mark=MARK, report='equal')

def measure(bench):
    for count in COUNTS[:1] if bench.quick else COUNTS:
        yield measure_pairs(bench, count, bench.small(CONE), 1 if bench.quick else max(bench.runs, 3))

TABLES = {'direct': Table(
    'Static connections (Straja) against a broker', 'direct', HEADER, measure,
    'Pairs of runs by turns; broker / direct must be %g at most in the median. The broker has its workers before it has the job; '
    '`--direct` calls them, within what is timed.' % MARK,
    {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', 'workers': '{workers} emulated', 'rays/s': '{rays_per_s:.1f}',
     'best possible, s': '{best_s:.3f}', 'broker, s': '{broker_s:.3f}', 'direct, s': '{direct_s:.3f}',
     'broker / direct': '{ratio:.4f} ({least_ratio:.4f} to {greatest_ratio:.4f})', 'mark': '{verdict}', 'report': '{report}'},
    lambda line: float(line['ratio']) > float(line['mark']))}
