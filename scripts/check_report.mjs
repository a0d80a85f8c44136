// Opens the report of an experiment in headless Chromium, as on a desk and as on a phone, and tries its 3D views.
//
//   node scripts/check_report.mjs report.html FOLDER
//
// Writes FOLDER/desktop.png, phone.png and, where the report has 3D views, desktop_view.png, phone_view.png with the
// weights of a joint and desktop_play.png in motion. Fails when the page writes an error to the console, asks for
// anything that is not in the file, is wider than the screen, or when a 3D view does not open, does not paint or does
// not move. Exit code 77: Chromium is not installed.
import {mkdirSync, mkdtempSync, rmSync, statSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

import {chromium} from './chromium.mjs';
import {Browser, Page, kScreens, pause} from './devtools.mjs';

async function look(browser, url, name, folder) {
  const page = await Page.open(browser, url, kScreens[name]);
  await page.picture(path.join(folder, name + '.png'));
  await page.checkWidth();

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
  await page.close();
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
