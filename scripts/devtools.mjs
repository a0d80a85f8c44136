// Chromium without a window, driven by the DevTools protocol, for the scripts that use a page as people do.
import {spawn} from 'node:child_process';
import {writeFileSync} from 'node:fs';

export const kScreens = {
  desktop: {width: 1280, height: 900, deviceScaleFactor: 1, mobile: false},
  phone: {width: 390, height: 844, deviceScaleFactor: 2, mobile: true},
};
const kSeconds = 60;  // for the page to load, and for what until() waits for

// The DevTools protocol over two pipes: JSON messages that end in a zero byte.
export class Browser {
  constructor(program, profile) {
    this.child = spawn(program, ['--headless=new', '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
                                 '--no-first-run', '--hide-scrollbars', `--user-data-dir=${profile}`, '--remote-debugging-pipe'],
                       {stdio: ['ignore', 'ignore', 'ignore', 'pipe', 'pipe']});
    this.waiting = new Map();
    this.listeners = [];
    this.next = 1;
    let text = '';
    this.child.stdio[4].setEncoding('utf8');
    this.child.stdio[4].on('data', (part) => {
      text += part;
      for (let end; (end = text.indexOf('\0')) >= 0; text = text.slice(end + 1)) this.receive(JSON.parse(text.slice(0, end)));
    });
    this.child.on('exit', () => this.waiting.forEach(({reject}) => reject(new Error('the browser stopped'))));
  }
  receive(message) {
    if (message.id === undefined) return this.listeners.forEach((listen) => listen(message));
    const {resolve, reject} = this.waiting.get(message.id);
    this.waiting.delete(message.id);
    message.error ? reject(new Error(message.error.message)) : resolve(message.result);
  }
  send(method, params = {}, sessionId = undefined) {
    const id = this.next++;
    this.child.stdio[3].write(JSON.stringify({id, method, params, sessionId}) + '\0');
    return new Promise((resolve, reject) => this.waiting.set(id, {resolve, reject}));
  }
}

export const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

// One page, and what went wrong in it: errors on the console, and requests for what it may not ask for.
export class Page {
  constructor(browser, session) {
    this.send = (method, params) => browser.send(method, params, session);
    this.problems = [];
    browser.listeners.push(({method, params, sessionId}) => {
      if (sessionId !== session) return;
      if (method === 'Page.loadEventFired') this.loaded = true;
      if (method === 'Runtime.exceptionThrown') this.problems.push('exception: ' + (params.exceptionDetails.exception?.description ?? params.exceptionDetails.text));
      if (method === 'Runtime.consoleAPICalled' && params.type === 'error') this.problems.push('console: ' + params.args.map((a) => a.description ?? a.value).join(' '));
      if (method === 'Log.entryAdded' && params.entry.level === 'error') this.problems.push(['log:', params.entry.text, params.entry.url ?? ''].join(' ').trim());
      if (method === 'Network.requestWillBeSent' && !/^(data|blob):/.test(params.request.url) && params.request.url !== this.url && !this.allowed(params.request.url)) this.problems.push('asked for ' + params.request.url);
    });
  }
  // A page at this address. @param allowed requests beside the page itself and data in it: a function of the address
  static async open(browser, url, screen, allowed = () => false) {
    const {targetId} = await browser.send('Target.createTarget', {url: 'about:blank'});
    const {sessionId} = await browser.send('Target.attachToTarget', {targetId, flatten: true});
    const page = new Page(browser, sessionId);
    Object.assign(page, {url, allowed, close: () => browser.send('Target.closeTarget', {targetId})});
    for (const domain of ['Page', 'Runtime', 'Log', 'Network', 'DOM']) await page.send(domain + '.enable');
    await page.send('Emulation.setDeviceMetricsOverride', screen);
    await page.send('Page.navigate', {url});
    for (const end = Date.now() + 1000 * kSeconds; !page.loaded;) {
      if (Date.now() > end) throw new Error('the page did not load');
      await pause(50);
    }
    return page;
  }
  async value(expression) {
    const {result, exceptionDetails} = await this.send('Runtime.evaluate', {expression, awaitPromise: true, returnByValue: true});
    if (exceptionDetails) throw new Error(exceptionDetails.exception?.description ?? exceptionDetails.text);
    return result.value;
  }
  async until(expression, what) {
    for (const end = Date.now() + 1000 * kSeconds; Date.now() < end; await pause(100)) if (await this.value(expression)) return;
    throw new Error(what + ` did not happen within ${kSeconds} s`);
  }
  async picture(file) {
    const {data} = await this.send('Page.captureScreenshot', {format: 'png'});
    writeFileSync(file, Buffer.from(data, 'base64'));
  }
  // The page is no wider than the screen.
  async checkWidth() {
    const wide = await this.value(`(() => {
      const room = document.documentElement.clientWidth;
      if (document.documentElement.scrollWidth <= room + 1) return '';
      const wide = [...document.body.querySelectorAll('*')].filter((e) => !e.closest('.wide, pre, svg') && e.scrollWidth > e.clientWidth + 1);
      return document.documentElement.scrollWidth - room + ' pixels wider than the screen: ' + (wide.pop()?.outerHTML ?? '').slice(0, 120);
    })()`);
    if (wide !== '') this.problems.push('the page is ' + wide);
  }
}
