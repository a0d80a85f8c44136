// Opens the report of an experiment in headless Chromium, as on a desk and as on a phone, and tries its 3D views.
//
//   node scripts/check_report.mjs report.html FOLDER
//
// Writes FOLDER/desktop.png, phone.png and, where the report has 3D views, desktop_view.png, phone_view.png with the
// weights of a joint and desktop_play.png in motion. Fails when the page writes an error to the console, asks for
// anything that is not in the file, is wider than the screen, or when a 3D view does not open, does not paint or does
// not move. Exit code 77: Chromium is not installed.
import {spawn} from 'node:child_process';
import {mkdirSync, mkdtempSync, rmSync, statSync, writeFileSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

import {chromium} from './chromium.mjs';

const kScreens = {
  desktop: {width: 1280, height: 900, deviceScaleFactor: 1, mobile: false},
  phone: {width: 390, height: 844, deviceScaleFactor: 2, mobile: true},
};
const kSeconds = 60;  // until a view must have opened

// The DevTools protocol over two pipes: JSON messages that end in a zero byte.
class Browser {
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

const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

class Page {
  constructor(browser, session) {
    this.send = (method, params) => browser.send(method, params, session);
    this.problems = [];
    browser.listeners.push(({method, params, sessionId}) => {
      if (sessionId !== session) return;
      if (method === 'Page.loadEventFired') this.loaded = true;
      if (method === 'Runtime.exceptionThrown') this.problems.push('exception: ' + (params.exceptionDetails.exception?.description ?? params.exceptionDetails.text));
      if (method === 'Runtime.consoleAPICalled' && params.type === 'error') this.problems.push('console: ' + params.args.map((a) => a.description ?? a.value).join(' '));
      if (method === 'Log.entryAdded' && params.entry.level === 'error') this.problems.push('log: ' + params.entry.text);
      if (method === 'Network.requestWillBeSent' && !/^(data|blob):/.test(params.request.url) && params.request.url !== this.url) this.problems.push('asked for ' + params.request.url);
    });
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
}

async function look(browser, url, name, folder) {
  const {targetId} = await browser.send('Target.createTarget', {url: 'about:blank'});
  const {sessionId} = await browser.send('Target.attachToTarget', {targetId, flatten: true});
  const page = new Page(browser, sessionId);
  page.url = url;
  for (const domain of ['Page', 'Runtime', 'Log', 'Network']) await page.send(domain + '.enable');
  await page.send('Emulation.setDeviceMetricsOverride', kScreens[name]);
  await page.send('Page.navigate', {url});
  for (const end = Date.now() + 1000 * kSeconds; !page.loaded;) {
    if (Date.now() > end) throw new Error('the page did not load');
    await pause(50);
  }
  await page.picture(path.join(folder, name + '.png'));
  const wide = await page.value(`(() => {
    const room = document.documentElement.clientWidth;
    if (document.documentElement.scrollWidth <= room + 1) return '';
    const wide = [...document.body.querySelectorAll('*')].filter((e) => !e.closest('.wide, pre, svg') && e.scrollWidth > e.clientWidth + 1);
    return document.documentElement.scrollWidth - room + ' pixels wider than the screen: ' + (wide.pop()?.outerHTML ?? '').slice(0, 120);
  })()`);
  if (wide !== '') page.problems.push('the page is ' + wide);

  const views = await page.value('document.querySelectorAll(".viewer3d").length');
  for (let i = 0; i < views; ++i) {
    const view = `document.querySelectorAll(".viewer3d")[${i}]`, part = (c) => `${view}.querySelector("${c}")`;
    const pixels = () => page.value(part('canvas') + '.toDataURL()');
    await page.value(view + '.scrollIntoView()');
    await page.until(view + '.dataset.state !== undefined', 'opening the 3D view');
    if (await page.value(view + '.dataset.state') !== 'open') {
      page.problems.push(await page.value(view + '.textContent'));
      continue;
    }
    const plain = await pixels();
    await page.value(`{ const s = ${part('.joint')}; s.selectedIndex = Math.min(2, s.options.length - 1); s.dispatchEvent(new Event("change")); }`);
    const painted = await pixels();
    if (plain === painted) page.problems.push('painting the weights of a joint changes nothing');
    await page.picture(path.join(folder, name + '_view.png'));
    await page.value(part('.play') + '.click()');
    await page.until(`${part('canvas')}.toDataURL() !== ${JSON.stringify(painted)}`, 'motion');
    await pause(700);
    await page.value(part('.play') + '.click()');
    if (name === 'desktop') await page.picture(path.join(folder, 'desktop_play.png'));
  }
  await browser.send('Target.closeTarget', {targetId});
  return {views, problems: page.problems};
}

const [report, folder] = process.argv.slice(2);
if (folder === undefined) {
  console.error('usage: node scripts/check_report.mjs report.html FOLDER');
  process.exit(2);
}
const program = chromium();
if (program === undefined) {
  console.error('Chromium is not installed');
  process.exit(77);
}
mkdirSync(folder, {recursive: true});
const profile = mkdtempSync(path.join(os.tmpdir(), 'anigen-browser-'));
const browser = new Browser(program, profile);
let failed = false;
try {
  for (const name of Object.keys(kScreens)) {
    const {views, problems} = await look(browser, pathToFileURL(path.resolve(report)).href, name, folder);
    for (const problem of problems) console.error(`${name}: ${problem}`);
    console.log(`${name}: ${views} 3D views, ${problems.length} problems`);
    failed ||= problems.length > 0;
  }
  console.log(`${report}: ${(statSync(report).size / 1e6).toFixed(1)} MB`);
} catch (error) {
  console.error(String(error));
  failed = true;
}
browser.child.kill('SIGKILL');
await pause(300);
rmSync(profile, {recursive: true, force: true, maxRetries: 5});
process.exit(failed ? 1 : 0);
