"""Ways to deal a picture out to machines of speeds 1 : 2 : 4, and a film's frames to machines."""
import json, os, statistics, subprocess, sys
import harness
from tables_bench import CONE, GLASS, FIRST, LAST, Table, spread, speeds

HEADER = FIRST + ['frames', 'schedule', 'workers', 'rays', 'best_s', 'elapsed_s', 'least_s', 'greatest_s', 'client_s', 'ratio', 'mark'] + LAST
MIXED = ((4, 1), (4, 2), (4, 4))
WAYS = ('demand', 'static', 'weighted', 'stealing')
MARK = 1.02 # of demand's time over the best possible
FRAMES, TRAVEL = 12, 'scenes/travels/cone.raj'
FILM = CONE._replace(size='160x120')
FILM_WORKERS = (8, 48)

def line(bench, table, picture, frames, schedule, groups, rays, elapsed, mark=None, client=()):
    best = bench.best(rays, groups)
    median = statistics.median(elapsed)
    return bench.line(table, picture, frames=frames, schedule=schedule, workers=speeds(groups), rays=rays,
                      best_s='%.4f' % best, **dict(zip(('elapsed_s', 'least_s', 'greatest_s'), spread(elapsed))),
                      client_s='%.4f' % statistics.median(client) if client else '', ratio='%.4f' % (median / best), mark=mark or '')

def measure_ways(bench, picture):
    """One farm for all of them; by turns, so that they have the same luck."""
    rays = bench.truth(picture)[0]
    best = bench.best(rays, MIXED)
    elapsed = {way: [] for way in WAYS}
    with bench.farm(*MIXED) as farm:
        bench.have_drawn(picture, ['-b', farm.broker], best)
        for _ in range(bench.runs):
            for way in WAYS:
                elapsed[way].append(bench.seconds(picture, ['-b', farm.broker, '--schedule', way], best))
    return [line(bench, 'schedules', picture, 1, way, MIXED, rays, elapsed[way], MARK if way == 'demand' else None) for way in WAYS]

def film(bench, picture, options, frames, name):
    """What fraja-submit tells of a film, and its pictures' bytes."""
    pattern = os.path.join(bench.scratch, name + '%04d.ppm')
    run = subprocess.run(bench.words(picture) + ['--travel', TRAVEL, '--frames', frames, '--json', '-o', pattern] + options,
                         stdout=subprocess.PIPE, text=True)
    if run.returncode:
        sys.exit('fraja-submit --travel failed')
    told = json.loads(run.stdout)
    pixels = []
    for frame in told['frames']:
        with open(frame['output'], 'rb') as file:
            pixels.append(file.read())
    return told, pixels

def rays_of(bench, farm, told):
    """Of a film: its jobs know."""
    jobs = [json.loads(subprocess.run([bench.programs + '/fraja-ctl', '-b', farm.broker, 'show', frame['job'], '--json'],
                                      capture_output=True, text=True, check=True).stdout) for frame in told['frames']]
    return sum(job['rays']['total'] for job in jobs)

def measure_film(bench, picture, count):
    """Frames to machines, and one frame after the other."""
    every = '1-%d' % FRAMES
    pixels = film(bench, picture, ['--local'], every, 'local')[1]
    with harness.Farm(bench.programs, 1, bench.scratch) as farm: # alone, a worker draws nothing twice
        rays = rays_of(bench, farm, film(bench, picture, ['-b', farm.broker], every, 'farm')[0])
    films, singles = [], [] # what the broker tells, and what the client takes
    with bench.farm((count, 1)) as farm:
        film(bench, picture, ['-b', farm.broker], every, 'farm') # has it drawn
        for _ in range(bench.runs):
            told, drawn = film(bench, picture, ['-b', farm.broker], every, 'farm')
            films.append((max(frame['elapsed_s'] for frame in told['frames']), told['wall_s']))
            each = [film(bench, picture, ['-b', farm.broker], '%d-%d' % (n, n), 'farm') for n in range(1, FRAMES + 1)]
            singles.append((sum(one['frames'][0]['elapsed_s'] for one, _ in each), sum(one['wall_s'] for one, _ in each)))
            if drawn != pixels or [one for _, (one,) in each] != pixels:
                sys.exit('%s: the farm draws another film than --local' % (picture,))
    return [line(bench, 'film', picture, FRAMES, schedule, ((count, 1),), rays, elapsed, client=client)
            for schedule, (elapsed, client) in (('frames to machines', zip(*films)), ('one frame after the other', zip(*singles)))]

def measure(bench):
    for picture in (CONE, GLASS):
        yield from measure_ways(bench, bench.small(picture))

def measure_films(bench):
    for count in FILM_WORKERS[:1] if bench.quick else FILM_WORKERS:
        yield from measure_film(bench, bench.small(FILM), count)

def missed(line):
    return float(line['ratio']) > float(line['mark']) if line['mark'] else None

COLUMNS = {'scene': '{scene}', '-r': '{size}', '-d': '{depth}', '-a': '{aa}', 'frames': '{frames}', 'schedule': '{schedule}',
           'workers': '{workers} emulated', 'best possible, s': '{best_s:.3f}', 'elapsed, s': '{elapsed_s:.3f} ({least_s:.3f} to {greatest_s:.3f})',
           'elapsed / best': '{ratio:.4f}'}
TABLES = {
    'schedules': Table(
        'Schedules', 'schedules', HEADER, measure,
        'All on one farm. The mark: demand takes at most %g times the best possible time, rays / the sum of speeds.' % MARK,
        {**COLUMNS, 'mark': '{verdict}'}, missed),
    'film': Table(
        'A film', 'schedules', HEADER, measure_films,
        '`%s`. Elapsed is what the broker tells: the longest of the film\'s frames, which are all submitted at once; the sum of those that are '
        'submitted one after the other. Beside it what `fraja-submit --travel` takes in all, or one for each frame, until the files are '
        'written, without the loading of its libraries.' % TRAVEL,
        {**COLUMNS, 'fraja-submit, s': '{client_s:.3f}'}, missed)}
