#!/usr/bin/env python3
"""page_test.py PROGRAMS SCENES: the live page of fraja-watch --serve, in a real browser, with a farm of real processes."""
import os, signal, subprocess, sys, tempfile, unittest
sys.path[:0] = [os.path.dirname(os.path.abspath(__file__)),
                os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'tools', 'bench')]
import harness, webdriver

PROGRAMS, SCENES = sys.argv[1:3]
HOSTILE = '<img src=x onerror="document.title=\'taken\'"><script>document.title="taken"</script>'
# Seconds of one thread's work in many tiles.
LONG = ['overlapping_spheres', '--kernel', 'reference', '-r', '160x120', '-a', '3', '--tile', '8']

def program(name, *words):
    told = subprocess.run([PROGRAMS + '/fraja-' + name, *words], capture_output=True, text=True, timeout=100)
    if told.returncode:
        raise AssertionError(name + ': ' + told.stderr)
    return told.stdout.strip()

# A function for scripts: an image's pixels, RGBA.
PIXELS = '''
    function pixels(image) {
        const canvas = document.createElement('canvas');
        [canvas.width, canvas.height] = [image.naturalWidth, image.naturalHeight];
        const context = canvas.getContext('2d');
        context.drawImage(image, 0, 0);
        return context.getImageData(0, 0, canvas.width, canvas.height).data;
    }
'''

class Served:
    """fraja-watch --serve with its page."""
    def __init__(self, farm, *words, port=0):
        self.process = subprocess.Popen([PROGRAMS + '/fraja-watch', '-b', farm.broker, '--serve', '127.0.0.1:%d' % port, *words],
                                        stdout=subprocess.PIPE, stderr=farm.log, text=True)
        self.url = self.process.stdout.readline().split()[1] # page URL
        self.port = int(self.url.rstrip('/').rpartition(':')[2])
    def end(self):
        self.process.terminate()
        self.process.stdout.close()
        return self.process.wait()

class PageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.browser = cls.enterClassContext(webdriver.Browser())

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())
        self.farm = self.enterContext(harness.Farm(PROGRAMS, 0, self.folder, state=self.folder + '/state'))
        self.browser.size(1280, 900)
        self.browser.scheme('light')

    def serve(self, *words, **where):
        served = Served(self.farm, *words, **where)
        self.addCleanup(lambda: served.process.poll() is None and served.end())
        return served

    def submit(self, scene, *words):
        return program('submit', '-b', self.farm.broker, '--detach', '%s/%s.raj' % (SCENES, scene), *words)

    def open(self, served, job=None):
        self.browser.open('about:blank') # so that the same address is loaded anew
        self.browser.complaints() # about what is not there any more
        self.browser.open(served.url + ('#job=' + job if job else ''))

    def test_the_picture_grows_to_the_final_one(self):
        job, served = self.submit(*LONG), self.serve()
        self.open(served)
        self.browser.wait('return document.querySelector("#job-state").textContent === "queued"')
        self.browser.do(PIXELS + '''
            const picture = document.querySelector('#picture'), bar = document.querySelector('#progress');
            window.seen = [];
            picture.addEventListener('load', () => window.seen.push([bar.value, pixels(picture).filter((v, i) => i % 4 < 3 && v > 0).length]));''')
        self.farm.start_worker(1)
        self.browser.wait('return document.querySelector("#job-state").textContent === "done"')
        self.browser.wait('return document.querySelector("#picture").dataset.url.includes("picture.png")')
        seen = self.browser.do('return window.seen')
        self.assertGreaterEqual(len({lit for _, lit in seen}), 3, 'pictures on the way to the last one')
        for before, after in zip(seen, seen[1:]):
            self.assertLessEqual(before[0], after[0], 'progress')
            self.assertLessEqual(before[1], after[1] + 2000, 'pixels that are not black (.jpg is not exact at its edges)')
        self.assertGreater(seen[-1][1], 2 * seen[0][1])
        self.assertEqual(self.browser.text('#percent'), '100%')
        # What is shown is the page's .png to the last level, and that is what fraja-ctl gets to the last byte.
        whole, differ = self.browser.ask('POST', '/execute/async', {'args': [], 'script': PIXELS + """
            const [done] = arguments, image = document.querySelector('#picture'), shown = pixels(image);
            fetch(image.src).then(answer => answer.blob()).then(async blob => {
                const other = new Image();
                other.src = image.src;
                await other.decode();
                const exact = pixels(other);
                done([Array.from(new Uint8Array(await blob.arrayBuffer())), exact.filter((v, i) => v !== shown[i]).length]);
            });"""})
        self.assertEqual(differ, 0)
        file = self.folder + '/got.png'
        program('ctl', '-b', self.farm.broker, 'get', job, '-o', file)
        with open(file, 'rb') as got:
            self.assertEqual(bytes(whole), got.read())
        self.assertEqual(self.browser.complaints(), [])

    def test_maps_show_costs_and_workers(self):
        self.farm.start_worker(1)
        self.farm.start_worker(1)
        self.farm.await_workers(2)
        job, served = self.submit(*LONG), self.serve()
        self.open(served, job)
        self.browser.wait('return document.querySelector("#job-state").textContent === "done"')
        for layer, words in (('cost', ['a pixel']), ('workers', ['worker-0', 'worker-1', 'tile'])):
            self.browser.click('[data-layer=%s]' % layer)
            self.browser.wait('return document.querySelector("#map").dataset.url.includes(arguments[0])', layer)
            colours = self.browser.do(PIXELS + '''
                const p = pixels(document.querySelector('#map')), colours = new Set();
                for (let i = 0; i < p.length; i += 4) colours.add(p.slice(i, i + 3).join());
                return [colours.size, document.querySelector('#map').naturalWidth];''')
            self.assertEqual(colours[1], 160 // 8, 'a pixel for each cell')
            self.assertGreaterEqual(colours[0], 2)
            for word in words:
                self.assertIn(word, self.browser.text('#legend'))
        self.browser.click('[data-layer=picture]')
        self.assertFalse(self.browser.do('return document.querySelector("#legend").checkVisibility()'))

    def test_the_page_goes_on_after_the_broker_was_killed(self):
        job, served = self.submit(*LONG), self.serve()
        self.open(served, job)
        self.browser.wait('return document.querySelector("#connection").textContent === "connected"')
        self.browser.do('window.loaded_once = true')
        self.farm.start_worker(1)
        self.browser.wait('return document.querySelector("#progress").value > 0')
        with self.farm.processes[0] as broker: # and waits for its end
            broker.kill()
        self.browser.wait('return document.querySelector("#connection").textContent.includes("lost")')
        self.farm.processes[0] = self.farm.start_broker(self.farm.broker, self.farm.stream)
        self.browser.wait('return document.querySelector("#connection").textContent === "connected"')
        self.browser.wait('return document.querySelector("#job-state").textContent === "done"')
        self.browser.wait('return document.querySelector("#picture").dataset.url.includes("picture.png")')
        self.assertTrue(self.browser.do('return window.loaded_once'), 'it was not loaded anew')

    def test_the_page_goes_on_after_fraja_watch_was_away(self):
        job, served = self.submit('cone', '-r', '40x30'), self.serve()
        self.open(served, job)
        self.browser.wait('return document.querySelector("#connection").textContent === "connected"')
        self.assertEqual(served.end(), 143)
        self.browser.wait('return document.querySelector("#notice").innerText.includes("fraja-watch is gone")')
        self.serve(port=served.port)
        self.browser.wait('return document.querySelector("#connection").textContent === "connected"')
        self.assertEqual(self.browser.text('#notice'), '')

    def test_names_are_text_whatever_they_say(self):
        self.farm.start_worker(1)
        job, served = self.submit('cone', '-r', '40x30', '-n', HOSTILE), self.serve()
        self.open(served, job)
        self.browser.wait('return document.querySelector("#job-state").textContent === "done"')
        self.assertEqual(self.browser.do('return document.querySelector("#job-title").textContent'), HOSTILE)
        self.assertEqual(self.browser.do('return document.querySelector("#jobs .name").textContent'), HOSTILE)
        self.assertEqual(self.browser.do('return document.querySelectorAll("[onerror], body script").length'), 0)
        self.assertNotEqual(self.browser.do('return document.title'), 'taken')
        self.assertEqual(self.browser.complaints(), [])

    def test_buttons_are_there_where_control_is_allowed_alone(self):
        job, served = self.submit(*LONG), self.serve()
        self.open(served, job)
        self.browser.wait('return document.querySelector("#job-state").textContent === "queued"')
        self.assertFalse(self.browser.do('return document.querySelector("#controls").checkVisibility()'))
        self.open(self.serve('--allow-control'), job)
        self.browser.wait('return document.querySelector("#controls").checkVisibility()')
        for button, state in (('#pause', 'paused'), ('#pause', 'queued')): # it is there to resume, then
            self.browser.click(button)
            self.browser.wait('return document.querySelector("#job-state").textContent === arguments[0]', state)
        self.browser.click('#cancel')
        self.browser.click('#ask-no')
        self.browser.click('#cancel')
        self.assertIn('#1?', self.browser.text('#ask-text'))
        self.browser.click('#ask-yes')
        self.browser.wait('return document.querySelector("#job-state").textContent === "cancelled"')
        self.assertIn('"cancelled"', program('ctl', '-b', self.farm.broker, '--json', 'show', job))
        self.assertFalse(self.browser.do('return document.querySelector("#controls").checkVisibility()'))

    def test_the_job_that_was_named_is_opened_first(self):
        self.submit('cone', '-r', '40x30', '-n', 'older')
        self.submit('cone', '-r', '40x30', '-n', 'newer')
        self.open(self.serve('older'))
        self.browser.wait('return document.querySelector("#job-title").textContent === "older"')
        self.browser.click('#jobs li:first-child button')
        self.browser.wait('return document.querySelector("#job-title").textContent === "newer"')

    def test_it_fits_a_phone_and_the_dark(self):
        self.farm.start_worker(1)
        self.farm.await_workers(1)
        job, served = self.submit('cone', '-r', '400x300', '-n', 'a_name_without_any_gap_' * 5), self.serve('--allow-control')
        self.browser.size(360, 740, mobile=True)
        self.open(served, job)
        self.browser.wait('return document.querySelector("#job-state").textContent === "done" && !document.querySelector("#picture").hidden')
        self.assertEqual(self.browser.do('return [innerWidth, document.documentElement.scrollWidth]'), [360, 360])
        brightness = '''return getComputedStyle(arguments[0] ? document.querySelector(arguments[0]) : document.body)
            .backgroundColor.match(/[0-9]+/g).slice(0, 3).reduce((a, b) => a + Number(b), 0)'''
        light = self.browser.do(brightness, 'body')
        self.browser.scheme('dark')
        dark = self.browser.do(brightness, 'body')
        self.assertGreater(light, 600)
        self.assertLess(dark, 150)

    def test_it_is_zoomed_by_keys_and_wheel(self):
        self.farm.start_worker(1)
        job, served = self.submit('cone', '-r', '2400x600'), self.serve() # more than an overview has
        self.open(served, job)
        self.browser.wait('return document.querySelector("#job-state").textContent === "done" && !document.querySelector("#picture").hidden')
        self.assertEqual(self.browser.do('return document.querySelector("#picture").naturalWidth'), 1200)
        width = 'return document.querySelector("#picture").getBoundingClientRect().width'
        fitted = self.browser.do(width)
        stage = 'const stage = document.querySelector("#stage"), box = stage.getBoundingClientRect();'
        self.browser.do(stage + 'stage.dispatchEvent(new WheelEvent("wheel", { deltaY: -900, clientX: box.left + 99, clientY: box.top + 99 }))')
        self.assertGreater(self.browser.do(width), 4 * fitted)
        self.browser.wait('const part = document.querySelector("#part"); return !part.hidden && part.naturalWidth === parseFloat(part.style.width)')
        self.browser.do(stage + 'stage.dispatchEvent(new KeyboardEvent("keydown", { key: "0" }))')
        self.assertAlmostEqual(self.browser.do(width), fitted, places=2)
        self.assertTrue(self.browser.do('return document.querySelector("#part").hidden'))

if __name__ == '__main__':
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1)) # so that what was started is ended
    unittest.main(argv=sys.argv[:1] + sys.argv[3:], verbosity=2)
