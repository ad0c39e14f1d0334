"""Points of other ray tracers for time_error: run time against error, each where it is installed."""
import array, math, os, shlex, shutil, struct, sys, zlib
import harness

def png_samples(path):
    """The samples of an RGB picture of 8 or 16 bits, from 0 to 1, row by row."""
    data = open(path, 'rb').read()
    at, packed = 8, b''
    while at < len(data):
        length, kind = struct.unpack('>I4s', data[at:at + 8])
        body = data[at + 8:at + 8 + length]
        if kind == b'IHDR':
            width, height, depth, colour = struct.unpack('>IIBB', body[:10])
            assert depth in (8, 16) and colour == 2, 'not RGB of 8 or 16 bits'
        elif kind == b'IDAT':
            packed += body
        at += 12 + length
    pixel = 3 * depth // 8
    raw, stride, before, samples = zlib.decompress(packed), pixel * width, bytes(pixel * width), []
    for y in range(height):
        kind, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for i in range(stride):
            left, up, corner = line[i - pixel] if i >= pixel else 0, before[i], before[i - pixel] if i >= pixel else 0
            if kind == 1: add = left
            elif kind == 2: add = up
            elif kind == 3: add = (left + up) // 2
            elif kind == 4:
                guess = left + up - corner
                add = min((left, up, corner), key=lambda v: abs(guess - v))
            else: add = 0
            line[i] = (line[i] + add) & 255
        before = bytes(line)
        samples.extend(v / (2 ** depth - 1) for v in struct.unpack('>%d%s' % (3 * width, 'H' if depth == 16 else 'B'), before))
    return samples

def ppm_samples(path):
    """The samples of a binary PPM of 16 bits, from 0 to 1, row by row."""
    data = open(path, 'rb').read()
    words, at = [], 0
    while len(words) < 4:
        end = data.index(b'\n', at)
        words += data[at:end].split(b'#')[0].split()
        at = end + 1
    assert (words[0], words[3]) == (b'P6', b'65535'), 'not a binary PPM of 16 bits'
    values = array.array('H', data[at:])
    if sys.byteorder == 'little':
        values.byteswap()
    return [v / 65535 for v in values]

def float_samples(path):
    """Of a file of 32-bit floats."""
    with open(path, 'rb') as file:
        return array.array('f', file.read())

def shrunk(picture, width, scale):
    """Each pixel the mean of scale x scale."""
    row = 3 * width * scale
    return [sum(picture[(scale * y + j) * row + 3 * (scale * x + i) + c] for j in range(scale) for i in range(scale)) / scale ** 2
            for y in range(len(picture) // row // scale) for x in range(width) for c in range(3)]

def row_of(scene, method, setting, seconds, picture, truth):
    """As the benchmark's program writes one; nobody tells samples and rays."""
    errors = sorted(abs(min(a, 1) - min(b, 1)) for a, b in zip(picture, truth))
    level = lambda v: int(255 * min(v, 1) + .5)
    off = sum(any(abs(level(picture[i + c]) - level(truth[i + c])) > 1 for c in range(3)) for i in range(0, len(picture), 3))
    return [scene, method, setting, '', '', '%.3f' % max(seconds, .001),
            '%.7f' % math.sqrt(sum(e * e for e in errors) / len(errors)), '%.5f' % errors[-1],
            '%.5f' % errors[int(.999 * (len(errors) - 1))], '%.6f' % (off / (len(picture) // 3))]

class PovRay:
    """Its pictures are held against one of its own, of 27 x 27 samples: it shades glass otherwise than Raja."""
    name, package = 'POV-Ray', 'povray'
    def __init__(self, options):
        pass
    def can(self, scene, made):
        return made and shutil.which('povray')
    def rows(self, scene, path, size, depth, quick, folder, truth):
        def draw(extent, *options):
            words = ['povray', '+I' + path.replace('.raj', '.pov'), '+BM2', '+W%d' % extent[0], '+H%d' % extent[1],
                     '+WT1', '-D', '+FN16', 'File_Gamma=1.0', '+Oout.png', *options]
            return harness.user_seconds(words, folder), png_samples(os.path.join(folder, 'out.png'))
        start = min(draw((8, 8), '-A')[0] for _ in range(3))
        # Method 1 with a threshold of 0 supersamples where neighbours differ at all; more than 9 x 9 it does not.
        scale = 2 if quick else 3
        own = shrunk(draw((scale * size[0], scale * size[1]), '+AM1', '+A0.00', '+R9', '-J')[1], size[0], scale)
        settings = [['-A']] + [['+AM1', '+A%.2f' % a, '+R%d' % r, '-J'] for r in (3, 5, 9) for a in (.1, .03, 0)]
        settings += [['+AM2', '+A%.2f' % a, '+R%d' % r, '-J'] for r in (3, 4) for a in (.1, .03, 0)]
        for s in settings[:4] if quick else settings:
            seconds, picture = draw(size, *s)
            yield row_of(scene, self.name, ' '.join(s), seconds - start, picture, own)

class Tachyon:
    """Its pictures are held against one of its own, of 1024 samples: it counts depth otherwise. It refracts nothing."""
    name, package = 'Tachyon', 'tachyon'
    def __init__(self, options):
        pass
    def can(self, scene, made):
        return scene in ('c', 'c5', 'chess') and shutil.which('tachyon')
    def rows(self, scene, path, size, depth, quick, folder, truth):
        def draw(samples, extent=size):
            words = ['tachyon', path.replace('.raj', '.dat'), '-res', str(extent[0]), str(extent[1]), '-numthreads', '1', '-raydepth', str(depth),
                     '-aasamples', str(samples - 1), '-format', 'PPM48', '-o', 'out.ppm']
            return harness.user_seconds(words, folder), ppm_samples(os.path.join(folder, 'out.ppm'))
        start = min(draw(1, (8, 8))[0] for _ in range(3))
        own = draw(64 if quick else 1024)[1]
        for samples in (1, 4, 16) if quick else (1, 4, 9, 16, 36, 64, 144):
            seconds, picture = draw(samples)
            yield row_of(scene, self.name, str(samples), seconds - start, picture, own)

class Raja:
    """Its pictures, of 8 bits, are held against ours: it is the same picture. `--raja` says how to run it."""
    name, package = 'Raja', None
    def __init__(self, options):
        self.command = shlex.split(options.get('--raja', ''))
    def can(self, scene, made):
        return self.command and scene in ('cone', 'overlapping_spheres', 'b', 'rows', 'csg', 'mirrors', 'chess') # in minutes
    def rows(self, scene, path, size, depth, quick, folder, truth):
        def draw(side, extent=size):
            words = self.command + ['-r', '%dx%d' % extent, '-d', str(depth), '-a', str(side), '-o', 'out.png', path]
            return harness.user_seconds(words, folder), png_samples(os.path.join(folder, 'out.png'))
        start = min(draw(0, (1, 1))[0] for _ in range(3))
        for side in (1, 2) if quick else (1, 2, 4, 8):
            seconds, picture = draw(side)
            yield row_of(scene, self.name, '-a %d' % side, seconds - start, picture, truth)

ALL = [PovRay, Tachyon, Raja]
