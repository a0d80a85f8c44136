// The studio as people use it, in headless Chromium: both doors, motions, an edited joint with new weights, a comparison,
// a check, downloads, and the page on a phone.
//
//   node tests/e2e/studio.mjs ANIGEN_STUDIO SOURCE FOLDER
//
// Writes FOLDER/studio.png, studio_edit.png, studio_compare.png and studio_phone.png. Fails when the page writes an
// error to the console, asks anyone but the studio, or a step does not do what it says. Exit code 77: Chromium or three.js
// is not installed.
import {spawn, spawnSync} from 'node:child_process';
import {existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';

import {chromium} from '../../scripts/chromium.mjs';
import {Browser, Page, kScreens, pause} from '../../scripts/devtools.mjs';

const [program, source, folder] = process.argv.slice(2).map((word) => path.resolve(word));
if (folder === undefined) {
  console.error('usage: node tests/e2e/studio.mjs ANIGEN_STUDIO SOURCE FOLDER');
  process.exit(2);
}
const browserFile = chromium();
if (browserFile === undefined) {
  console.log('not supported: Chromium is not installed');
  process.exit(77);
}

function expect(condition, what) {
  if (!condition) throw new Error(what);
}

// A worm with a bend, closed.
function wormObj() {
  const rings = 28, sides = 14, lines = [];
  for (let r = 0; r < rings; r++) {
    const t = r / (rings - 1), x = t - 0.5, z = 0.15 * Math.sin(3 * t), radius = 0.07 + 0.03 * Math.sin(9 * t);
    for (let s = 0; s < sides; s++) {
      const a = 2 * Math.PI * s / sides;
      lines.push(`v ${x} ${z + radius * Math.cos(a)} ${radius * Math.sin(a)}`);
    }
  }
  for (let r = 0; r + 1 < rings; r++)
    for (let s = 0; s < sides; s++) {
      const a = r * sides + s + 1, b = r * sides + (s + 1) % sides + 1;
      lines.push(`f ${a} ${b} ${b + sides} ${a + sides}`);
    }
  const cap = (from, order) => lines.push('f ' + order.map((s) => from + s + 1).join(' '));
  const around = [...Array(sides).keys()];
  cap(0, [...around].reverse());
  cap((rings - 1) * sides, around);
  return lines.join('\n') + '\n';
}

// The program, until it prints its address.
function startStudio(output) {
  const child = spawn(program, ['--output', output], {stdio: ['ignore', 'pipe', 'pipe']});
  return new Promise((resolve, reject) => {
    let said = '', warned = '';
    child.stderr.on('data', (part) => warned += part);
    child.stdout.on('data', (part) => {
      said += part;
      if (said.includes('\n')) resolve({child, address: said.trim(), warned: () => warned});
    });
    child.on('exit', (code) => reject(new Error(`anigen-studio ended with ${code}: ${warned}`)));
  });
}

const text = (id) => `document.getElementById(${JSON.stringify(id)}).textContent`;
const click = (page, selector) => page.value(`document.querySelector(${JSON.stringify(selector)}).click()`);
const jobsOf = async (address) => (await (await fetch(address + 'api/jobs')).json()).jobs;

async function giveFile(page, selector, file) {
  const {root} = await page.send('DOM.getDocument');
  const {nodeId} = await page.send('DOM.querySelector', {nodeId: root.nodeId, selector});
  await page.send('DOM.setFileInputFiles', {files: [file], nodeId});
}

// Waits for a job of this name to end and to be shown. Returns it.
async function shown(page, address, name) {
  for (const end = Date.now() + 120_000; Date.now() < end; await pause(100)) {
    const job = (await jobsOf(address)).find((one) => one.name === name);
    if (job?.state === 'failed') throw new Error(`${name}: ${job.error}`);
    if (job?.state !== 'done') continue;
    await page.until(`document.body.dataset.shown?.startsWith('${job.id}/')`, 'showing ' + name);
    return job;
  }
  throw new Error(name + ' did not end');
}

async function pointer(page, type, [x, y], buttons = 0) {
  await page.send('Input.dispatchMouseEvent', {type, x, y, buttons, button: type === 'mouseMoved' && buttons === 0 ? 'none' : 'left', clickCount: 1});
}

// Taps a joint on the canvas, takes its arrow and drags it. Returns the joint's row.
async function dragJoint(page) {
  await page.value('window.scrollTo(0, 0)');
  const box = await page.value('(({left, top}) => [left, top])(document.querySelector("#stage canvas").getBoundingClientRect())');
  const joint = await page.value('Math.floor(studio.editor.joints.length / 2)');
  const where = async () => (await page.value('studio.editor.onScreen()'))[joint].map((v, i) => v + box[i]);
  const place = await where();
  await pointer(page, 'mousePressed', place, 1);
  await pointer(page, 'mouseReleased', place);
  const chosen = await page.value('studio.editor.chosen');
  expect(chosen >= 0, 'a tap on a joint chooses none');
  await pause(200);
  for (let far = 20; far < 140; far += 5) {
    for (let turn = 0; turn < 24; turn++) {
      const a = 2 * Math.PI * turn / 24, at = [place[0] + far * Math.cos(a), place[1] + far * Math.sin(a)];
      await pointer(page, 'mouseMoved', at);
      if (!/^[XYZ]$/.test(await page.value('studio.editor.gizmo.axis ?? ""'))) continue;
      await pointer(page, 'mousePressed', at, 1);
      for (let step = 1; step <= 5; step++, await pause(150)) await pointer(page, 'mouseMoved', [at[0] + 6 * step * Math.cos(a), at[1] + 6 * step * Math.sin(a)], 1);
      await pointer(page, 'mouseReleased', [at[0] + 30 * Math.cos(a), at[1] + 30 * Math.sin(a)]);
      return chosen;
    }
  }
  throw new Error('no arrow of the joint was found');
}

async function edit(page, job) {
  await click(page, '[data-tab=edit]');
  const before = await page.value('JSON.stringify(studio.editor.joints)'), joints = JSON.parse(before).length;
  const bound = async (what) => {
    await page.until(`/^bound in/.test(${text('bound')})`, 'binding after ' + what);
    const said = await page.value(text('bound'));
    await page.value(`document.getElementById('bound').textContent = ''`);
    return said;
  };
  const moved = await dragJoint(page);
  console.log('a joint moved: ' + await bound('a move'));
  console.log(`weights followed ${await page.value('document.body.dataset.drafts ?? 0')} times while it was dragged`);
  expect(await page.value('Number(document.body.dataset.drafts ?? 0)') > 0, 'weights do not follow while a joint is dragged');
  const after = JSON.parse(await page.value('JSON.stringify(studio.editor.joints)'))[moved].position;
  expect(Math.hypot(...after.map((v, i) => v - JSON.parse(before)[moved].position[i])) > 1e-3, 'dragging moves no joint');
  const edited = await page.value(`(async () => (await (await fetch('/api/jobs/${job.id}/files/edited.glb')).arrayBuffer()).byteLength)()`);
  expect(edited > 1000, 'there is no edited.glb');
  const shownPlace = await page.value(`studio.stage.rest.map((p) => p.toArray())`);
  expect(shownPlace.some((p) => Math.hypot(...p.map((v, i) => v - after[i])) < 1e-4), 'the bound rig has the joint elsewhere');
  await page.picture(path.join(folder, 'studio_edit.png'));
  // Weights are painted from grey over yellow to red, on a mesh without normals, too.
  const [tinted, black] = await page.value(`(() => {
    const from = document.querySelector('#stage canvas'), copy = document.createElement('canvas');
    [copy.width, copy.height] = [from.width, from.height];
    const context = copy.getContext('2d');
    context.drawImage(from, 0, 0);
    const data = context.getImageData(0, 0, copy.width, copy.height).data;
    let tinted = 0, black = 0;
    for (let i = 0; i < data.length; i += 4) {
      if (data[i] - data[i + 2] > 20 && Math.abs(data[i] - data[i + 1]) < 40) tinted++;
      if (data[i] + data[i + 1] + data[i + 2] < 60) black++;
    }
    return [tinted, black];
  })()`);
  expect(tinted > 300 && black < 300, `painted weights show ${tinted} tinted and ${black} black pixels`);
  for (const [button, count] of [['add_joint', joints + 1], ['delete_joint', joints], ['undo', joints + 1], ['undo', joints],
                                 ['redo', joints + 1]]) {
    await click(page, '#' + button);
    await bound(button);
    expect(await page.value('studio.editor.joints.length') === count, `${button}: not ${count} joints`);
  }
  await page.value(`(() => { const n = document.getElementById('joint_name'); n.value = 'tip_L'; n.dispatchEvent(new Event('change')); })()`);
  await bound('a new name');
  await click(page, '#mirror_joint');
  await bound('mirror');
  expect((await page.value('studio.editor.joints.map((j) => j.name)')).includes('tip_R') ||
         await page.value('studio.editor.joints.length') === joints + 1, 'mirror gives no joint of the other side');
  await page.value('studio.editor.choose(Math.floor(studio.editor.joints.length / 3))');
  await click(page, '#centre_joint');
  await bound('centre');
  await click(page, '[data-tab=view]');
  expect(await page.value(text('failure')) === '' || await page.value(`document.getElementById('failure').hidden`), 'an edit failed: ' + await page.value(text('failure')));
}

async function compare(page) {
  await click(page, '[data-tab=compare]');
  await page.value(`for (const box of document.querySelectorAll('#methods input')) box.checked = ['curve', 'heat', 'nearest'].includes(box.value)`);
  await click(page, '#compare');
  await page.until(`document.body.dataset.compared !== undefined`, 'comparing');
  const count = Number(await page.value('document.body.dataset.compared'));
  expect(count === 4, `${count} riggers side by side, not 4: ` + await page.value(text('comparing')));
  await pause(800);
  await page.value(`document.getElementById('compare_stages').scrollIntoView()`);
  await page.picture(path.join(folder, 'studio_compare.png'));
  console.log(count + ' riggers in one motion');
}

async function check(page, truth) {
  await click(page, '[data-tab=check]');
  await page.until(`document.querySelectorAll('#findings li').length > 0`, 'checking');
  await giveFile(page, '#truth', truth);
  await page.until(`document.querySelectorAll('#scores tr').length > 3`, 'metrics');
  console.log('check: ' + await page.value(`document.querySelector('#findings li').textContent`));
}

async function downloads(address, job) {
  const files = [];
  for (const name of ['rigged.glb', 'edited.glb', 'rigged.fbx', 'edited.fbx', 'rigged.usdz']) {
    const answer = await fetch(`${address}api/jobs/${job.id}/files/${name}`);
    expect(answer.ok, `${name}: ${answer.status}`);
    const bytes = Buffer.from(await answer.arrayBuffer());
    expect(bytes.length > 1000, name + ' is empty');
    writeFileSync(path.join(folder, name), bytes);
    if (name.endsWith('.glb')) files.push(path.join(folder, name));
  }
  const validated = spawnSync(process.execPath, [path.join(source, 'scripts/validate_gltf.mjs'), ...files], {
    encoding: 'utf8', cwd: source, env: {...process.env, NODE_PATH: [path.join(source, '.cache/node/node_modules'), process.env.NODE_PATH ?? ''].join(path.delimiter)},
  });
  expect(validated.status === 0 || validated.status === 77, 'the validator refuses: ' + validated.stdout + validated.stderr);
  console.log(`5 downloads; validator: ${validated.status === 0 ? 'no errors' : 'not installed'}`);
}

mkdirSync(folder, {recursive: true});
const work = mkdtempSync(path.join(os.tmpdir(), 'anigen-studio-'));
const worm = path.join(work, 'worm.obj');
writeFileSync(worm, wormObj());
let studio, browser, failed = false, skipped = false;
try {
  const started = Date.now();
  studio = await startStudio(path.join(work, 'jobs'));
  const {address} = studio;
  if (!(await (await fetch(address + 'api/studio')).json()).three) {
    console.log('not supported: three.js is not installed');
    skipped = true;
  } else {
    browser = new Browser(browserFile, path.join(work, 'profile'));
    const page = await Page.open(browser, address, kScreens.desktop, (url) => url.startsWith(address));
    await page.until(`document.body.dataset.ready === 'yes'`, 'the page');
    await page.until(`performance.getEntriesByType('paint').length > 0`, 'the first paint');
    console.log(`first paint after ${Math.round(await page.value(`performance.getEntriesByType('paint')[0].startTime`))} ms`);
    const generates = (await jobsOf(address)).length > 0;
    if (generates) {
      await shown(page, address, 'deer.png');
      console.log(`a creature of the first start after ${((Date.now() - started) / 1000).toFixed(1)} s`);
      await pause(1200);
      await page.picture(path.join(folder, 'studio.png'));
      await giveFile(page, '#image_door input', path.join(source, 'examples/creatures/bird.png'));
      const bird = await shown(page, address, 'bird.png');
      console.log(`image: ${bird.result.joints} joints in ${bird.result.seconds} s, models loaded`);
    }
    await page.value(`document.getElementById('method').value = 'curve'`);
    await giveFile(page, '#mesh_door input', worm);
    const job = await shown(page, address, 'worm.obj');
    console.log(`mesh: ${job.result.joints} joints in ${job.result.seconds} s, clips ${job.result.clips.join(' ')}`);
    // The command that the page shows makes a rig of as many joints.
    const command = await page.value(text('command'));
    const repeated = spawnSync('sh', ['-c', command + ' --json'], {
      encoding: 'utf8', cwd: work, env: {...process.env, PATH: path.dirname(program) + path.delimiter + process.env.PATH},
    });
    expect(command.startsWith('anigen-rig worm.obj --method curve') && repeated.status === 0, command + ': ' + repeated.stderr);
    const clips = await page.value('studio.stage.clips.length');
    expect(clips === job.result.clips.length && clips > 0, `${clips} clips in the viewer`);
    const pose = await page.value('JSON.stringify(studio.stage.places())');
    await page.until(`JSON.stringify(studio.stage.places()) !== ${JSON.stringify(pose)}`, 'motion');
    await edit(page, job);
    await downloads(address, job);
    await check(page, path.join(folder, 'rigged.glb'));
    await compare(page);
    await page.checkWidth();
    const phone = await Page.open(browser, address, kScreens.phone, (url) => url.startsWith(address));
    await phone.until(`document.body.dataset.shown !== undefined`, 'the page on a phone');
    await phone.value(`document.getElementById('tabs').scrollIntoView()`);
    await pause(500);
    await phone.checkWidth();
    await phone.picture(path.join(folder, 'studio_phone.png'));
    const problems = [...page.problems, ...phone.problems.map((problem) => 'phone: ' + problem)];
    for (const problem of problems) console.error(problem);
    failed = problems.length > 0;
    console.log(`${problems.length} problems`);
  }
} catch (error) {
  console.error(String(error?.stack ?? error));
  failed = true;
}
browser?.child.kill('SIGKILL');
if (studio !== undefined) {
  studio.child.removeAllListeners('exit');
  const ended = new Promise((resolve) => studio.child.on('exit', resolve));
  studio.child.kill('SIGINT');
  const code = await Promise.race([ended, pause(20_000).then(() => 'no end within 20 s of Ctrl-C')]);
  if (code !== 0) failed = true, console.error('anigen-studio: ' + code);
  studio.child.kill('SIGKILL');
}
await pause(300);
if (existsSync(work)) rmSync(work, {recursive: true, force: true, maxRetries: 5});
process.exit(failed ? 1 : skipped ? 77 : 0);
