"""What time_error makes of its runs: marks, tables, plots."""
import math, os, statistics, subprocess

HEADER = ['scene', 'method', 'setting', 'spp', 'rays', 'user_s', 'rmse', 'max_error', 'p999', 'off_by_more_than_one']
KEPT_HEADER = ['scene', 'wanted', 'spp', 'refined', 'refined_rms', 'rmse', 'estimated_rmse', 'halo']
METHODS = [('grid', "Raja's grid"), ('jittered', 'jittered grid'), ('sobol-owen', 'Sobol-Owen (--spp)'),
           ('adaptive', 'adaptive (--error)'), ('povray-1', "POV-Ray's method 1, in Fraja"),
           ('povray-2', "POV-Ray's method 2, in Fraja"), ('POV-Ray', 'POV-Ray'), ('Tachyon', 'Tachyon'), ('Raja', 'Raja, in Java')]
SPP, RAYS, SECONDS, RMSE = 3, 4, 5, 6

def points(rows, scene, method, column):
    return sorted((float(r[column]), float(r[RMSE])) for r in rows
                  if r[0] == scene and r[1] == method and r[column] and float(r[RMSE]) > 0)

def hull(pairs):
    """Of a method with several thresholds the settings that none is better than, from the cheapest on."""
    best = []
    for x, y in pairs:
        if not best or y < best[-1][1]:
            best.append((x, y))
    return best

def at(pairs, error):
    """What it takes to come down to an error, between two settings on lines in a log-log plot; None beyond them."""
    pairs = hull(pairs)
    for (x0, y0), (x1, y1) in zip(pairs, pairs[1:]):
        if y1 <= error <= y0:
            share = math.log(y0 / error) / math.log(y0 / y1)
            return math.exp(math.log(x0) + share * math.log(x1 / x0))
    return None

def cost(rows, scene, method, column, error):
    return at(points(rows, scene, method, column), error)

def ratio(rows, scene, method, column, error):
    """How many times less the adaptive pictures take."""
    theirs, ours = cost(rows, scene, method, column, error), cost(rows, scene, 'adaptive', column, error)
    return theirs / ours if theirs and ours else None

# ------------------------------------------------------------------------------------------------ marks
def table(head, lines):
    return ['| ' + ' | '.join(head) + ' |', '|---' * len(head) + '|'] + ['| ' + ' | '.join(l) + ' |' for l in lines] + ['']

def marks(rows, kept, scenes):
    """Lines of what was promised, what was measured, and whether that is enough; what was not run is left out.

    Seen elsewhere: one plain surface, the same bits everywhere (tests), --time-limit (tools/bench/time_limit).
    """
    lines = []
    def line(what, mark, figure, enough):
        lines.append((what, mark, figure, 'yes' if enough else '**no**'))
    def reached(what, mark, scenes_needed, figures, judge):
        """Where something was not run there is no line; where a curve does not come down so far, it is missed."""
        if not all(any(r[0] == s for r in rows) for s in scenes_needed):
            return
        if not all(figures):
            line(what, mark, 'not reached', False)
        else:
            line(what, mark, *judge(*figures))
    reached('overlapping_spheres 640x480 to 0.005, samples per pixel', '<= 30', ['overlapping_spheres_640'],
            [cost(rows, 'overlapping_spheres_640', 'adaptive', SPP, .005)], lambda spp: ('%.1f' % spp, spp <= 30))
    for scene, error in (('b', .0067), ('c', .0017)):
        ours = cost(rows, scene, 'adaptive', SECONDS, error)
        compared = lambda mark: lambda theirs, ours: ('%.2f s : %.2f s = %.1f' % (theirs, ours, theirs / ours), theirs >= mark * ours)
        if any(r[:2] == [scene, 'POV-Ray'] for r in rows):
            reached('%s to %g, user time, POV-Ray at its best : adaptive' % (scene, error), '>= 12', [scene],
                    [cost(rows, scene, 'POV-Ray', SECONDS, error), ours], compared(12))
        grid = [float(r[SECONDS]) for r in rows if r[:3] == [scene, 'grid', '8']]
        reached('%s to %g, user time, 8x8 grid : adaptive' % (scene, error), '>= 3', [scene], [*grid, ours], compared(3))
    cases = [(float(k[1]), float(k[4]), float(k[5]), k[0]) for k in kept if float(k[1]) <= 8]
    refined = [c for c in cases if c[1] > 0] # in others no pixel was
    if refined:
        good = sum(rms <= wanted for wanted, rms, _, _ in refined) / len(refined)
        worst = max((rms / wanted, scene, wanted) for wanted, rms, _, scene in refined)
        whole = max((rmse / wanted, scene, wanted) for wanted, _, rmse, scene in cases)
        count = '%d cases, %d scenes' % (len(refined), len({k[3] for k in refined}))
        line('--error E: refined pixels\' RMS <= E (%s)' % count, '>= 95 %', '%.1f %%' % (100 * good), good >= .95)
        line('--error E: refined pixels\' RMS, worst', '<= 1.5 E', '%.2f E (%s, E = %g)' % worst, worst[0] <= 1.5)
        line('--error E: picture\'s RMSE, worst', '<= E', '%.2f E (%s, E = %g)' % whole, whole[0] <= 1)
    for scene in scenes:
        reached('%s to 0.003, rays, Raja\'s grid : adaptive' % scene, '>= 8', [scene], [ratio(rows, scene, 'grid', RAYS, .003)],
                lambda value: ('%.1f' % value, value >= 8))
    for error in (.005, .003, .002, .001):
        found = {s: ratio(rows, s, 'sobol-owen', RAYS, error) for s in scenes}
        reach = {s: r for s, r in found.items() if r}
        if reach:
            middle, least = statistics.median(reach.values()), min(reach, key=reach.get)
            count = '%d of %d scenes reach it' % (len(reach), len(found))
            line('to %g, rays, Sobol-Owen : adaptive, median (%s)' % (error, count), '>= 1.3', '%.2f' % middle, middle >= 1.3)
            line('to %g, rays, Sobol-Owen : adaptive, least' % error, '>= 1.15', '%.2f (%s)' % (reach[least], least), reach[least] >= 1.15)
    for wanted in sorted({float(k[1]) for k in kept if k[0] in scenes}):
        halo = max((float(k[7]), k[0]) for k in kept if float(k[1]) == wanted and k[0] in scenes)
        line('share of samples drawn for tiles beside, E = %g, worst' % wanted, '<= 2 %', '%.1f %% (%s)' % (100 * halo[0], halo[1]), halo[0] <= .02)
    return lines

# ------------------------------------------------------------------------------------------------ report
def report(rows, kept, truths, left_out, scenes, found, command):
    """The page, as lines of Markdown; `found`: the marks."""
    lines = ['# Run time against error', '', 'One thread; user seconds; RMS error over pixels and colours, linear, of 1, that of colours limited to 0..1. '
             'Made by `%s`.' % command, '',
             'Errors are those to a converged picture of 4096 samples per pixel, whose own error is told below; those of POV-Ray and '
             'Tachyon are to one of their own, as they shade otherwise: of 27 x 27 samples where neighbours differ, and of 1024. How '
             'wrong these are is not known.', '']
    lines += left_out + ['']
    lines += ['## Marks', ''] + table(['what', 'mark', 'measured', 'met'], found)
    for column, what in ((SECONDS, 'user seconds'), (RAYS, 'rays, with shadow rays')):
        for error in (.01, .005, .003):
            body = []
            for scene in scenes:
                figures = [cost(rows, scene, method, column, error) for method, _ in METHODS]
                ratios = [ratio(rows, scene, method, column, error) for method in ('grid', 'sobol-owen')]
                body.append([scene] + ['%.3g' % f if f else '-' for f in figures] + ['%.2f' % r if r else '-' for r in ratios])
            if body:
                lines += ['## To an RMS error of %g: %s' % (error, what), ''] + table(
                    ['scene'] + [title for _, title in METHODS] + ['grid : adaptive', 'Sobol-Owen : adaptive'], body)
    lines += ['## The error that was asked for, and the one there is', '', 'In 8-bit levels; `refined` and `halo` are shares of pixels and samples.', '']
    lines += table(KEPT_HEADER, kept)
    lines += ['## The converged pictures\' own error', ''] + table(['scene', 'rmse'], truths)
    return lines + ['## Every run', ''] + table(HEADER, rows)

def plot(rows, scene, column, label, suffix, folder):
    for terminal, ending in (("svg size 900,600 dynamic font 'sans,14' background 'white'", 'svg'),
                             ("pngcairo size 900,600 font 'sans,11'", 'png')):
        series = [(title, hull(points(rows, scene, method, column))) for method, title in METHODS]
        series = [(title, p) for title, p in series if p]
        script = ["set terminal " + terminal, "set output '%s'" % os.path.join(folder, '%s-%s.%s' % (scene, suffix, ending)),
                  "set logscale xy", "set grid", "set key outside right", "set title '%s'" % scene.replace('_', ' '),
                  "set xlabel '%s'" % label, "set ylabel 'RMS error, linear, of 1'", "set format y '%g'"]
        for i, (_, pairs) in enumerate(series):
            script += ['$p%d << EOD' % i] + ['%g %g' % pair for pair in pairs] + ['EOD']
        script.append('plot ' + ', '.join('$p%d using 1:2 with linespoints linewidth 2 pointtype %d title "%s"' % (i, 4 + i, title)
                                          for i, (title, _) in enumerate(series)))
        subprocess.run(['gnuplot'], input='\n'.join(script), text=True, check=True)
