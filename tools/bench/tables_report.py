"""The tables as they are kept (.csv), the page that is made of all of them, and the plots."""
import csv, os, subprocess
from tables_bench import SERVER_SECONDS

INTRODUCTION = """# The tables of the report of 2002, again

*Emulated* workers (`fraja-worker --emulate`) are threads of a stated speed, where no other is given one that draws cone at 640x480 in %g s,
as the report's server does: broker, sockets and pixels are real, and what tracing takes is waited for; 4 x 2 are four of them, twice as
fast. *Real* ones trace on the machine that all this was measured on. Elapsed is told by the broker, from when it acknowledged the job
on; a job that is not timed comes first, so the workers have the scene. Of several runs the median counts, with the least and the greatest
beside it. The commit is the last one that changed the programs or the scenes. Made by `tools/bench/tables` from the `.csv` files beside
this page; there are plots of the [utilisation](tables.svg) and of [what the client does](client.svg).""" % SERVER_SECONDS

def read(path, header):
    """A table's lines, if it has such columns."""
    if not os.path.exists(path):
        return []
    with open(path, newline='') as file:
        reader = csv.DictReader(file)
        lines = list(reader)
    if reader.fieldnames != header:
        print('%s has other columns: what it holds is left out' % path)
        return []
    return lines

def keep(path, header, order, lines):
    """Those of other tables stay; returns all."""
    new = [{name: str(value) for name, value in line.items()} for line in lines]
    measured = {line['table'] for line in new}
    every = [line for line in read(path, header) if line['table'] not in measured] + new
    every.sort(key=lambda line: order.index(line['table']))
    if new:
        write(path, header, every)
    return every

def write(path, header, lines):
    with open(path, 'w', newline='') as file:
        writer = csv.DictWriter(file, header)
        writer.writeheader()
        writer.writerows(lines)

def typed(text):
    try:
        return float(text) if set(text) & set('.') else int(text)
    except ValueError:
        return text

def section(title, note, columns, lines):
    """Of the page. `columns`: of each its title and how a line's values stand in it."""
    columns = {**columns, 'runs': '{runs}', 'date': '{date}', 'commit': '{commit}'}
    out = ['## ' + title, '', *([note, ''] if note else []), '| %s |' % ' | '.join(columns), '|---' * len(columns) + '|']
    for line in lines:
        values = {**{name: typed(text) for name, text in line.items()}, 'commit': line['commit'], 'date': line['date']}
        out.append('| %s |' % ' | '.join(form.format(**values) or '-' for form in columns.values()))
    return out + ['']

def page(folder, tables):
    """All of it, as lines of Markdown."""
    out = INTRODUCTION.split('\n') + ['']
    for name, table in tables.items():
        lines = [line for line in read(os.path.join(folder, table.file + '.csv'), table.header) if line['table'] == name]
        for line in lines:
            line['verdict'] = {None: '', False: 'kept', True: 'MISSED'}[table.missed(line)]
        if lines:
            out += section(table.title, table.note, table.columns, lines)
    return out

def plot(path, settings, series):
    """`series`: of each its title, pairs, and how gnuplot is to draw them."""
    script = ["set terminal svg size 900,600 dynamic font 'sans,14' background 'white'", "set output '%s'" % path, 'set grid',
              'set key outside bottom horizontal', *settings]
    for i, (_, pairs, _) in enumerate(series):
        script += ['$p%d << EOD' % i] + ['%g %g' % pair for pair in pairs] + ['EOD']
    script.append('plot ' + ', '.join('$p%d using 1:2 %s title "%s"' % (i, style, title) for i, (title, _, style) in enumerate(series)))
    subprocess.run(['gnuplot'], input='\n'.join(script), text=True, check=True)
