"""What the tables have in common: pictures, how they are drawn, what is known of each, and when."""
import collections, datetime, json, os, statistics, subprocess, sys
import harness

SERVER_SECONDS = 104 # of the report's server, for CONE
Picture = collections.namedtuple('Picture', 'scene size depth aa')
CONE, GLASS = Picture('cone', '640x480', 5, 0), Picture('overlapping_spheres', '640x480', 6, 0)
# What there is to measure. `file`: of the .csv, which tables may share; `measure(bench)` yields lines, `missed(line)` tells whether the
# mark is, or None where there is none; `columns` of the page: see tables_report.section().
Table = collections.namedtuple('Table', 'title file header measure note columns missed')
# What every table's lines open and end with.
FIRST, LAST = ['table', *Picture._fields], ['runs', 'date', 'commit']
# What is measured is in these; a change of anything else leaves the commit that a line names.
PROGRAMS = ('CMakeLists.txt', 'broker', 'client', 'common', 'scenes', 'tools/cmake', 'worker')

def commit():
    """That which changed the programs or the scenes last, with a + where they differ from it; - if this is no clone."""
    def git(*words):
        return subprocess.run(['git', *words, '--', *PROGRAMS], capture_output=True, text=True).stdout.strip()
    try:
        return (git('log', '-1', '--format=%h') or '-') + ('+' if git('status', '--porcelain') else '')
    except FileNotFoundError:
        return '-'

def in_bytes(size):
    width, height = size.split('x')
    return int(width) * int(height) * 12 # three floats

class Bench:
    """How this run measures, and where it keeps what it draws."""
    def __init__(self, programs, scratch, quick, runs, speedup):
        self.programs, self.scratch, self.quick, self.runs = programs, scratch, quick, runs
        self.truths, self.samples = {}, [] # of each picture its rays and bytes; of the client over time
        self.server = self.truth(CONE)[0] / SERVER_SECONDS * speedup * (10 if quick else 1)
        self.commit, self.date = commit(), datetime.date.today().isoformat()
    def line(self, table, picture, runs=None, **columns):
        """Of a table; as many columns as it has between the first and the last ones."""
        return {'table': table, **picture._asdict(), **columns, 'runs': runs or self.runs, 'date': self.date, 'commit': self.commit}
    def small(self, picture):
        """With --quick a tiny one in its place."""
        return picture._replace(size='64x48', aa=min(picture.aa, 2)) if self.quick else picture
    def farm(self, *groups, **options):
        """A farm with so many emulated workers, each group so many, so many times as fast as the report's server."""
        farm = harness.Farm(self.programs, 0, self.scratch, **options)
        if groups:
            farm.emulate(['%d@%.6f' % (count, self.server * times) for count, times in groups], sum(count for count, _ in groups))
        return farm
    def best(self, rays, groups):
        """What workers need at least."""
        return rays / (self.server * sum(count * times for count, times in groups))
    def words(self, picture):
        return [self.programs + '/fraja-submit', 'scenes/%s.raj' % picture.scene, '-r', picture.size, '-d', str(picture.depth),
                '-a', str(picture.aa), '--progress', 'none', '--log-level', 'error']
    def submit(self, picture, options, name, extension='.ppm'):
        """What fraja-submit tells, and the picture's bytes."""
        path = os.path.join(self.scratch, name + extension)
        run = subprocess.run(self.words(picture) + ['--stats', '--json', '-o', path] + options, stdout=subprocess.PIPE, text=True)
        if run.returncode:
            sys.exit('fraja-submit failed')
        with open(path, 'rb') as file:
            return json.loads(run.stdout), file.read()
    def truth(self, picture):
        if picture not in self.truths:
            told, pixels = self.submit(picture, ['--local'], 'local')
            self.truths[picture] = told['rays']['total'], pixels
        return self.truths[picture]
    def seconds(self, picture, options, best):
        """That the job takes, by the broker; the picture must be right."""
        rays, pixels = self.truth(picture)
        told, drawn = self.submit(picture, options, 'farm')
        if drawn != pixels or told['rays']['total'] < rays: # what was drawn twice counts twice
            sys.exit('%s: the farm draws another picture than --local' % (picture,))
        if told['elapsed_s'] < best:
            sys.exit('%s: %g s are less than the workers need, %g s' % (picture, told['elapsed_s'], best))
        return told['elapsed_s']
    def have_drawn(self, picture, options, best):
        """So that the emulated workers have its pixels."""
        if best <= (.03 if self.quick else 10):
            self.submit(picture, options, 'farm')
            return
        # It need not be drawn to the end: at the first tile, all of it has been traced.
        job = subprocess.run(self.words(picture) + options + ['--detach'], stdout=subprocess.PIPE, text=True, check=True).stdout.strip()
        with subprocess.Popen([self.programs + '/fraja-watch', *options[:2], job, '--json'], stdout=subprocess.PIPE, text=True) as watcher:
            for line in watcher.stdout:
                if json.loads(line)['schema'] == 'fraja.tile/1':
                    break
            watcher.terminate()
        subprocess.run([self.programs + '/fraja-ctl', *options[:2], 'cancel', job, '--yes'], capture_output=True, check=True)

def speeds(groups):
    """Workers, as a table shows them."""
    return ' + '.join('%d x %d' % group if len(groups) > 1 else str(group[0]) for group in groups)

def spread(values):
    """Median, least and greatest."""
    return ['%.4f' % f(values) for f in (statistics.median, min, max)]
