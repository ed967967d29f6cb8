# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A headless Chromium, driven by its own protocol over a pipe: no driver, no library."""

import json
import os
import select
import shutil
import subprocess
import time

NAMES = ('chromium', 'chromium-browser', 'google-chrome')
PATIENCE = 30.0  # s


def program():
    """Path of a Chromium, or None."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Browser:
    """One page of a browser.

    Parameters
    ----------
    home : Path
        For its profile.

    Attributes
    ----------
    complaints : list of str
        Errors, and what was written to the console, since `show`.
    asked : list of str
        Addresses that were asked for since then, the page itself first.
    """

    def __init__(self, home):
        to_read, to_browser = os.pipe()
        from_browser, to_write = os.pipe()
        options = ['--headless', '--no-sandbox', '--disable-gpu', '--no-first-run',
                   '--disable-dev-shm-usage', '--disable-extensions', '--hide-scrollbars',
                   '--remote-debugging-pipe', f'--user-data-dir={home}', 'about:blank']
        self._process = subprocess.Popen(
            ['bash', '-c', f'exec "$0" "$@" 3<&{to_read} 4>&{to_write}', program(), *options],
            pass_fds=(to_read, to_write), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env=os.environ | {'HOME': str(home)})
        os.close(to_read)
        os.close(to_write)
        self._out, self._in = to_browser, from_browser
        self._rest, self._number, self._session = b'', 0, None
        self.complaints, self.asked, self._loaded = [], [], False
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self._session = self.call('Target.attachToTarget', targetId=target,
                                  flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network', 'Performance'):
            self.call(f'{domain}.enable')

    def close(self):
        """End it."""
        os.close(self._out)
        try:
            self._process.wait(10.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._in)

    def call(self, method, **params):
        """Result of a method of the protocol."""
        self._number += 1
        number = self._number
        text = {'id': number, 'method': method, 'params': params}
        if self._session:
            text['sessionId'] = self._session
        data = json.dumps(text).encode() + b'\0'
        while data:
            data = data[os.write(self._out, data):]
        until = time.monotonic() + PATIENCE
        while True:
            told = self._next(until)
            if told.get('id') == number:
                if 'error' in told:
                    raise RuntimeError(f'{method}: {told["error"]}')
                return told['result']
            self._take(told)

    def _next(self, until):
        while b'\0' not in self._rest:
            left = until - time.monotonic()
            if left <= 0.0 or not select.select([self._in], [], [], left)[0]:
                raise TimeoutError('the browser does not answer')
            data = os.read(self._in, 1 << 20)
            if not data:
                raise RuntimeError('the browser has ended')
            self._rest += data
        text, self._rest = self._rest.split(b'\0', 1)
        return json.loads(text)

    def _take(self, told):
        method, params = told.get('method'), told.get('params', {})
        if method == 'Runtime.exceptionThrown':
            details = params['exceptionDetails']
            self.complaints.append(details.get('exception', details).get('description', 'error'))
        elif method == 'Runtime.consoleAPICalled':
            self.complaints.append(f'console.{params["type"]}')
        elif method == 'Log.entryAdded':
            self.complaints.append(params['entry']['text'])
        elif method == 'Network.requestWillBeSent':
            self.asked.append(params['request']['url'])
        elif method == 'Page.loadEventFired':
            self._loaded = True

    def window(self, width, dark=False, kind='screen'):
        """Width in pixels, colour scheme and medium."""
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=900,
                  deviceScaleFactor=1, mobile=False)
        scheme = 'dark' if dark else 'light'
        self.call('Emulation.setEmulatedMedia', media=kind, features=[
            {'name': 'prefers-color-scheme', 'value': scheme}])

    def show(self, path):
        """Open a file; seconds of work that it takes until it is there, laid out."""
        self.complaints, self.asked, self._loaded = [], [], False
        begin, worked = time.monotonic(), self._worked()
        self.call('Page.navigate', url=path.resolve().as_uri())
        while not self._loaded:
            self._take(self._next(begin + PATIENCE))
        self.run('document.documentElement.scrollHeight')
        now = self._worked()
        return now - worked if now > worked else now  # it may be another process

    def _worked(self):
        metrics = self.call('Performance.getMetrics')['metrics']
        return next(one['value'] for one in metrics if one['name'] == 'ProcessTime')

    def wait(self, expression):
        """Until JavaScript is true."""
        told = self.call('Runtime.evaluate', awaitPromise=True, returnByValue=True, expression=(
            f'new Promise(done => {{ const ask = () => {{ if ({expression}) done(true); '
            'else setTimeout(ask, 10) }; ask() })'))
        return told['result'].get('value')

    def run(self, expression):
        """Value of JavaScript."""
        told = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        if 'exceptionDetails' in told:
            raise RuntimeError(told['exceptionDetails']['exception']['description'])
        return told['result'].get('value')
