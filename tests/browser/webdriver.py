"""A real browser, Debian's Chromium, headless, spoken to by the WebDriver protocol: chromedriver and the standard library."""
import base64, http.client, json, os, shutil, subprocess, tempfile

CHROMIUM, CHROMEDRIVER = 'chromium', 'chromedriver'
# Nothing leaves this machine, and root may run it.
ARGUMENTS = ['--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
             '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage']

class Browser:
    """With an empty profile of its own; `with` ends it and what belongs to it."""
    def __init__(self, start=()):
        """`start`: words before the driver's own command line."""
        self.profile = tempfile.mkdtemp()
        # HOME: what Chromium leaves beside its profile. A group of its own: Chromium is many processes.
        self.driver = subprocess.Popen([*start, CHROMEDRIVER, '--port=0'], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                                       start_new_session=True, env={**os.environ, 'HOME': self.profile})
        port = next(int(line.rstrip('.\n').rpartition(' ')[2]) for line in self.driver.stdout if 'successfully on port' in line)
        self.connection = http.client.HTTPConnection('127.0.0.1', port, timeout=120)
        wish = {'browserName': 'chrome', 'goog:loggingPrefs': {'browser': 'ALL'}, 'goog:chromeOptions': {
            'binary': shutil.which(CHROMIUM), 'args': ARGUMENTS + ['--user-data-dir=' + self.profile]}}
        self.session = ''
        self.session = '/session/' + self.ask('POST', '/session', {'capabilities': {'alwaysMatch': wish}})['sessionId']
        self.ask('POST', '/timeouts', {'script': 100_000})

    def ask(self, method, path, body=None):
        self.connection.request(method, self.session + path, None if body is None else json.dumps(body))
        value = json.loads(self.connection.getresponse().read())['value']
        if isinstance(value, dict) and 'error' in value:
            raise RuntimeError(value['error'] + ': ' + value['message'])
        return value

    def open(self, url):
        self.ask('POST', '/url', {'url': url})

    def do(self, script, *arguments):
        """Runs a function's body in the page; what it returns."""
        return self.ask('POST', '/execute/sync', {'script': script, 'args': arguments})

    def wait(self, script, *arguments, seconds=60):
        """Until a function's body returns something true: that."""
        value = self.ask('POST', '/execute/async', {'script': '''
            const [body, given, ms, done] = arguments, ends = performance.now() + ms, wanted = new Function(...body);
            (function look() {
                let value = null;
                try { value = wanted(...given); } catch (error) { if (!(error instanceof TypeError)) throw error; }
                if (value || performance.now() > ends) done(value); else setTimeout(look, 20);
            })();''', 'args': [[script], list(arguments), 1000 * seconds]})
        if not value:
            raise AssertionError('in vain: ' + script + '\nthe page: ' + self.do('return document.body.innerText'))
        return value

    def text(self, selector):
        return self.do('return document.querySelector(arguments[0]).innerText', selector)

    def click(self, selector):
        """As a person does: what is hidden or covered cannot be clicked."""
        found = self.ask('POST', '/element', {'using': 'css selector', 'value': selector})
        self.ask('POST', '/element/%s/click' % next(iter(found.values())), {})

    def command(self, name, **parameters):
        """Of Chromium's own protocol."""
        return self.ask('POST', '/goog/cdp/execute', {'cmd': name, 'params': parameters})

    def size(self, width, height, mobile=False):
        self.command('Emulation.setDeviceMetricsOverride', width=width, height=height, deviceScaleFactor=2 if mobile else 1, mobile=mobile)

    def scheme(self, light_or_dark):
        self.command('Emulation.setEmulatedMedia', features=[{'name': 'prefers-color-scheme', 'value': light_or_dark}])

    def complaints(self):
        """What the browser has written to its console since the last time: of scripts, of the Content-Security-Policy, of answers."""
        return [entry['message'] for entry in self.ask('POST', '/se/log', {'type': 'browser'}) if entry['level'] != 'INFO']

    def screenshot(self):
        return base64.b64decode(self.ask('GET', '/screenshot'))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self.ask('DELETE', '')
        finally:
            self.connection.close()
            self.driver.terminate()
            self.driver.wait()
            self.driver.stdout.close()
            shutil.rmtree(self.profile, ignore_errors=True)
