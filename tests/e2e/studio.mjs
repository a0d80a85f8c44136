// The studio as people use it, in headless Chromium: both doors, motions, own motions, edited joints, painted weights,
// poses, downloads with the validator's verdict, a check, a comparison, masks, voxels of seeds, and the page on a phone.
//
//   node tests/e2e/studio.mjs ANIGEN_STUDIO SOURCE FOLDER [--pictures]
//
// Writes FOLDER/studio.png and studio_phone.png; with --pictures also those of each view. Fails when the page writes an
// error to the console, asks anyone but the studio, or a step does not do what it says. Exit code 77: Chromium or three.js
// is not installed.
import {spawnSync} from 'node:child_process';
import {copyFileSync, existsSync, mkdirSync, mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';

import {chromium} from '../../scripts/chromium.mjs';
import {Browser, Page, kScreens, pause} from '../../scripts/devtools.mjs';
import {User, expect, jobsOf, startStudio, stopStudio, text, waveBvh, wormObj} from './studio_support.mjs';

const [program, source, folder] = process.argv.slice(2, 5).map((word) => path.resolve(word));
const pictures = process.argv.includes('--pictures');
if (folder === undefined) {
  console.error('usage: node tests/e2e/studio.mjs ANIGEN_STUDIO SOURCE FOLDER [--pictures]');
  process.exit(2);
}
const browserFile = chromium();
if (browserFile === undefined) {
  console.log('not supported: Chromium is not installed');
  process.exit(77);
}

const kRefused = /^log: .*409.*edited\.vrm$/;  // a VRM of a worm, which is no error of the page
const started = Date.now();
const say = (what) => console.log(`${((Date.now() - started) / 1000).toFixed(1)} s  ${what}`);
const picture = async (user, name) => { if (pictures) await user.picture(path.join(folder, name)); };

// A mesh through its door; the command that the page shows makes a rig of as many joints.
async function riggedMesh(user, worm, work) {
  await user.set('method', 'curve');
  await user.giveFile('#mesh_door input', worm);
  const job = await user.shown(await user.job((one) => one.name === 'worm.obj', 'worm.obj'));
  say(`mesh: ${job.result.joints} joints in ${job.result.seconds} s, clips ${job.result.clips.join(' ')}`);
  const command = await user.value(text('command'));
  const repeated = spawnSync('sh', ['-c', command + ' --json'], {
    encoding: 'utf8', cwd: work, env: {...process.env, PATH: path.dirname(program) + path.delimiter + process.env.PATH},
  });
  expect(command.startsWith('anigen-rig worm.obj --method curve') && repeated.status === 0, command + ': ' + repeated.stderr);
  const clips = await user.value('studio.stage.clips.length');
  expect(clips === job.result.clips.length && clips > 0, `${clips} clips in the viewer`);
  const pose = await user.value('JSON.stringify(studio.stage.places())');
  await user.until(`JSON.stringify(studio.stage.places()) !== ${JSON.stringify(pose)}`, 'motion');
  await user.until(`document.querySelectorAll('#clips .clip').length === ${clips + 1} && [...document.querySelectorAll('#clips .clip')].every((tile) => tile.dataset.drawn)`, 'pictures of the clips');
  return job;
}

async function ownMotion(user, job, bvh) {
  await user.giveFile('#own_motion', bvh);
  const moved = await user.shown(await user.job((one) => one.kind === 'animation', 'wave.bvh'));
  const name = moved.result.clips.find((clip) => !job.result.clips.includes(clip));
  await user.until(`document.querySelector('#clips [aria-selected=true]')?.dataset.clip === ${JSON.stringify(name)}`, 'the own motion');
  say(`own motion ${name} in ${moved.result.seconds} s`);
  await user.show(job);
  await user.shown(job);
}

async function pose(user) {
  await user.open('pose');
  const corner = await user.corner('#stage canvas');
  const places = () => user.value('studio.stage.places().map((place) => place.toArray())');
  const before = await places();
  const tip = await user.value(`studio.stage.parents.findLastIndex((parent, j) => !studio.stage.parents.includes(j))`);
  const at = (await user.value(`studio.stage.onScreen(studio.stage.places())`))[tip].map((v, i) => v + corner[i]);
  const goal = [at[0] + 10, at[1] - 40];
  await user.drag([at, [at[0] + 5, at[1] - 20], goal]);
  const there = (await user.value(`studio.stage.onScreen(studio.stage.places())`))[tip].map((v, i) => v + corner[i]);
  expect(Math.hypot(there[0] - goal[0], there[1] - goal[1]) < 4, `a dragged joint is ${there}, not ${goal}`);
  await picture(user, 'studio_pose.png');
  await user.click('#pose_undo');
  const far = (a, b) => Math.max(...a.map((place, j) => Math.hypot(...place.map((v, i) => v - b[j][i]))));
  await user.value('studio.stage.draw()');
  expect(far(await places(), before) < 1e-5, 'undo leaves a pose');
  await user.click('#pose_redo');
  await user.click('#pose_reset');
  await user.value('studio.stage.draw()');
  expect(far(await places(), before) < 1e-5, 'reset leaves a pose');
  say('a pose by dragging');
}

// Drags a joint by itself: it goes to the middle of the mesh. Returns its row.
async function dragJoint(user) {
  const corner = await user.corner('#stage canvas');
  const joint = await user.value('Math.floor(studio.editor.joints.length / 2)');
  const place = (await user.value('studio.editor.onScreen()'))[joint].map((v, i) => v + corner[i]);
  await user.drag([place, place]);
  expect(await user.value('studio.editor.chosen') === joint, 'a tap on a joint does not choose it');
  // Weights follow before the joint is let go, however busy the machine is.
  await user.drag([0, 1, 2, 3, 4, 5].map((step) => [place[0] + 4 * step, place[1]]), 150,
                  () => user.until(`Number(document.body.dataset.drafts ?? 0) > 0`, 'weights that follow a dragged joint'));
  const off = await user.value(`(() => {
    const {stage, editor} = studio, [x, y] = editor.onScreen()[${joint}], box = stage.renderer.domElement.getBoundingClientRect();
    const middle = stage.middleOf(stage.rayAt({clientX: x + box.left, clientY: y + box.top}));
    return middle ? middle.distanceTo(editor.places()[${joint}]) / stage.size : 1;
  })()`);
  expect(off < 0.01, `a dragged joint is ${off} of the size from the middle of the mesh`);
  return joint;
}

// Takes an arrow of the chosen joint and drags it.
async function dragArrow(user) {
  const corner = await user.corner('#stage canvas'), joint = await user.value('studio.editor.chosen');
  const place = (await user.value('studio.editor.onScreen()'))[joint].map((v, i) => v + corner[i]);
  for (let far = 25; far < 140; far += 5) {
    for (let turn = 0; turn < 24; turn++) {
      const a = 2 * Math.PI * turn / 24, along = (r) => [place[0] + r * Math.cos(a), place[1] + r * Math.sin(a)];
      await user.mouse('mouseMoved', along(far));
      if (!/^[XYZ]$/.test(await user.value('studio.editor.gizmo.axis ?? ""'))) continue;
      return user.drag([0, 10, 20].map((step) => along(far + step)));
    }
  }
  throw new Error('no arrow of the joint was found');
}

async function edit(user, job) {
  await user.open('edit');
  const names = () => user.value('studio.editor.joints.map((joint) => joint.name)');
  const before = JSON.parse(await user.value('JSON.stringify(studio.editor.joints)')), count = before.length;
  const bound = async (what) => {
    await user.until(`/^(bound in|renamed)/.test(${text('bound')}) || !document.getElementById('failure').hidden`, 'binding after ' + what);
    expect(await user.failure() === '', what + ': ' + await user.failure());
    await user.value(`document.getElementById('bound').textContent = ''`);
  };
  // A name alone leaves the weights as they are.
  await user.set('joint_choice', '1');
  const weight = await user.value(weightOfChosen);
  await user.set('joint_name', 'second');
  await bound('a new name');
  const named = await user.value(weightOfChosen);
  expect((await names())[1] === 'second' && Math.abs(named - weight) < 1e-3 * (1 + weight), `a new name makes weights ${named} of ${weight}`);
  await user.click('#undo');
  await bound('undo of a name');
  const moved = await dragJoint(user);
  await bound('a move');
  const drafts = await user.value('Number(document.body.dataset.drafts ?? 0)');
  const after = JSON.parse(await user.value('JSON.stringify(studio.editor.joints)'))[moved].position;
  expect(Math.hypot(...after.map((v, i) => v - before[moved].position[i])) > 1e-3, 'dragging moves no joint');
  const rest = await user.value(`studio.stage.rest.map((place) => place.toArray())`);
  expect(rest.some((place) => Math.hypot(...place.map((v, i) => v - after[i])) < 1e-4), 'the bound rig has the joint elsewhere');
  await expectPainted(user);
  await picture(user, 'studio_edit.png');
  await dragArrow(user);
  await bound('an arrow');
  for (const [button, left] of [['add_joint', count + 1], ['delete_joint', count], ['undo', count + 1], ['undo', count], ['redo', count + 1]]) {
    await user.click('#' + button);
    await bound(button);
    expect((await names()).length === left, `${button}: not ${left} joints`);
  }
  await user.set('joint_name', 'tip_L');
  await bound('a new name');
  await user.click('#mirror_joint');
  await bound('mirror');
  expect((await names()).includes('tip_R') || (await names()).length === count + 1, 'mirror gives no joint of the other side');
  const mirrored = (await names()).length;
  await user.set('joint_choice', '2');
  await user.click('#merge_joint');
  await user.set('joint_choice', '1');
  await bound('merge');
  expect((await names()).length === mirrored - 1, 'merging leaves both joints');
  await user.click('#undo');
  await bound('undo of merge');
  expect((await names()).length === mirrored, 'undo does not bring back a merged joint');
  await user.click('#centre_joint');
  await bound('centre');
  await user.set('preset', 'chain');
  // The rig is bound before it gets its names, and nothing can be edited meanwhile.
  const old = await names(), steps = await user.value('studio.editor.past.length');
  await user.click('#rename_all');
  const held = await user.value(`(() => {
    const held = document.getElementById('edit_tools').disabled || ${text('bound')} === 'renamed';
    if (${text('bound')} !== 'renamed') document.getElementById('add_joint').click();
    return held;
  })()`);
  await user.until(`${text('bound')} === 'renamed'`, 'names by preset');
  expect(held && await user.value('studio.editor.past.length') === steps + 1, 'joints can be edited while names come');
  expect(!await user.value(`document.getElementById('edit_tools').disabled`), 'the editor stays locked after names came');
  await user.click('#undo');
  await user.until(`/^bound in/.test(${text('bound')})`, 'undo of names');
  expect((await names()).join() === old.join(), 'one step back does not take the names');
  await user.click('#redo');
  await bound('names by preset');
  say(`joints edited; weights followed ${drafts} times in a drag`);
  await paint(user, job, bound);
  await user.open('view');
  expect(await user.failure() === '', 'an edit failed: ' + await user.failure());
}

// Weights are painted from grey over yellow to red, on a mesh without normals, too.
async function expectPainted(user) {
  const [tinted, black] = await user.value(`(() => {
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
}

// Sum over the mesh of the weights of the chosen joint.
const weightOfChosen = `(() => {
  const {stage, editor} = studio, name = editor.joints[editor.chosen].name;
  let sum = 0;
  for (const mesh of stage.meshes) {
    const row = mesh.skeleton.bones.findIndex((bone) => (bone.userData.name ?? bone.name) === name);
    const {skinIndex, skinWeight} = mesh.geometry.attributes;
    for (let v = 0; v < skinIndex.count; v++)
      for (let k = 0; k < 4; k++) if (skinIndex.getComponent(v, k) === row) sum += skinWeight.getComponent(v, k);
  }
  return sum;
})()`;

// A stroke of the brush far from the chosen joint gives it weight; undo takes it.
async function paint(user, job, bound) {
  await user.set('joint_choice', '0');
  await user.click('#tool_paint');
  await user.set('brush_strength', '90');
  const corner = await user.corner('#stage canvas');
  // The joint on the mesh that is farthest from the root on the screen, and from there a little towards it.
  const [root, far] = await user.value(`(() => {
    const {stage, editor} = studio, box = stage.renderer.domElement.getBoundingClientRect(), screen = editor.onScreen(), [root] = screen;
    const on = screen.filter(([x, y]) => stage.middleOf(stage.rayAt({clientX: x + box.left, clientY: y + box.top})));
    const away = ([x, y]) => Math.hypot(x - root[0], y - root[1]);
    return [root, on.reduce((best, place) => away(place) > away(best) ? place : best)];
  })()`);
  const on = [0, 0.1, 0.2].map((t) => far.map((v, i) => v + t * (root[i] - v) + corner[i]));
  const before = await user.value(weightOfChosen);
  await user.drag(on, 100);
  await bound('a stroke');
  const strokes = await user.value('studio.editor.strokes.length'), after = await user.value(weightOfChosen);
  expect(strokes > 0 && after > before + 1, `${strokes} strokes change the weights from ${before} to ${after}`);
  await picture(user, 'studio_paint.png');
  await user.set('brush_mode', 'smooth');
  await user.drag(on.slice(0, 2));
  await bound('smoothing');
  await user.click('#undo');
  await bound('undo of smoothing');
  await user.click('#undo');
  await bound('undo of a stroke');
  const back = await user.value(weightOfChosen);
  expect(Math.abs(back - before) < 0.01 * (1 + before), `undo of a stroke leaves weights ${back}, not ${before}`);
  say(`painted weights: ${before.toFixed(1)} → ${after.toFixed(1)} in ${strokes} strokes`);
}

async function exports(user, job) {
  await user.open('export');
  await user.until(`/errors?,/.test(${text('verdict')}) || /not there/.test(${text('verdict')})`, 'the verdict of the validator');
  const verdict = await user.value(text('verdict'));
  expect(/: 0 errors|not there/.test(verdict), verdict);
  say(verdict);
  await picture(user, 'studio_export.png');
  const files = [];
  for (const name of ['rigged.glb', 'edited.glb', 'rigged.fbx', 'edited.usdz', 'rigged.zip']) {
    const answer = await fetch(`${user.address}v1/jobs/${job.id}/files/${name}`);
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
  // A worm is no humanoid: the page says so. The browser logs the refusal, too (kRefused).
  const said = `document.querySelector('[data-file="edited.vrm"]').parentElement.querySelector('span').textContent`;
  const before = await user.value(said);
  await user.click('[data-file="edited.vrm"]');
  await user.until(`![${JSON.stringify(before)}, '…'].includes(${said})`, 'the answer to a VRM');
  say('5 downloads; VRM: ' + await user.value(said));
}

async function check(user, truth) {
  await user.open('check');
  await user.until(`document.querySelectorAll('#findings li').length > 0`, 'checking');
  await user.giveFile('#truth', truth);
  await user.until(`document.querySelectorAll('#scores tr').length > 3`, 'metrics');
  say('check: ' + await user.value(`document.querySelector('#findings li').textContent`));
}

async function compare(user) {
  await user.open('compare');
  await user.value(`for (const box of document.querySelectorAll('#methods input')) box.checked = ['curve', 'heat', 'nearest'].includes(box.value)`);
  await user.click('#compare');
  await user.until(`document.body.dataset.compared !== undefined`, 'comparing');
  const count = Number(await user.value('document.body.dataset.compared'));
  expect(count === 4, `${count} riggers side by side, not 4: ` + await user.value(text('comparing')));
  if (pictures) {
    await pause(800);
    await picture(user, 'studio_compare.png');
  }
  await user.open('view');
  say(count + ' riggers in one motion');
}

// The image of the first start with its pictures; through the door one that stops at its voxels, those of another seed, a
// corrected mask, and on with one of them; one of the gallery that is cancelled.
async function images(user, image) {
  const deer = await user.job((one) => one.name === 'deer.png', 'deer.png');
  await user.show(deer);
  await user.shown(deer);
  say(`image: ${deer.result.joints} joints in ${deer.result.seconds} s; ${await user.value('document.body.dataset.events ?? 0')} events`);
  expect(await user.value('Number(document.body.dataset.events ?? 0)') > 0, 'no server-sent event came');
  await pause(pictures ? 4000 : 500);
  await user.picture(path.join(folder, 'studio.png'));
  await user.open('steps');
  const shown = await user.value(`[...document.querySelectorAll('#pictures figcaption')].map((one) => one.textContent)`);
  expect(['image', 'mask', 'voxels'].every((name) => shown.includes(name)), 'pictures of steps: ' + shown);
  await user.set('stop_at_voxels', true);
  await user.giveFile('#image_door input', image);
  await user.job((one) => one.name === 'again.png', 'voxels of again.png');
  await user.until(`document.getElementById('progress_line').textContent.startsWith('again.png: voxels')`, 'the voxels');
  await user.set('stop_at_voxels', false);
  await user.click('#another_seed');
  const voxels = await user.job((one) => one.name === 'again.png' && one.options.seed === 43, 'voxels of another seed');
  await user.until(`document.querySelectorAll('#seeds figure').length === 2 && document.querySelector('#seeds .go_on') !== null`, 'two seeds side by side');
  say(`voxels of seed ${voxels.options.seed} in ${voxels.result.seconds} s`);
  await picture(user, 'studio_seeds.png');
  await user.click('#correct_mask');
  await user.until(`document.getElementById('mask_dialog').open`, 'the mask');
  await pause(200);
  const [left, top, width, height] = await user.corner('#mask_canvas');
  await user.click('#mask_erase');
  await user.drag([0.1, 0.3, 0.5].map((t) => [left + t * width, top + 0.05 * height]));
  expect(await user.value(`document.getElementById('mask_canvas').dataset.strokes`) === '1', 'no stroke on the mask');
  await picture(user, 'studio_mask.png');
  await user.click('#mask_apply');
  const masked = await user.job((one) => one.names?.mask !== undefined, 'voxels with a mask');
  say(`voxels with a mask in ${masked.result.seconds} s`);
  await user.show(voxels);
  await user.until(`document.querySelector('#seeds .chosen .go_on') !== null`, 'the voxels');
  await user.click('#seeds .chosen .go_on');
  const whole = await user.shown(await user.job((one) => one.options.voxels_of === voxels.id, 'on with voxels'));
  say(`on with voxels: ${whole.result.joints} joints in ${whole.result.seconds} s`);
  await user.click('#gallery [title="Make dragon"]');
  await user.until(`studio.jobs.some((job) => job.name === 'dragon.png' && job.state === 'running')`, 'a job of the gallery');
  await user.click('#step_actions button');
  await user.until(`studio.jobs.some((job) => job.name === 'dragon.png' && job.state === 'cancelled')`, 'the end of a cancelled job');
  await user.show(whole);
  await user.shown(whole);
  return deer;
}

async function history(user) {
  await user.click('#open_history');
  await user.until(`document.querySelectorAll('#history_rows article').length === studio.jobs.length`, 'history');
  const commands = await user.value(`[...document.querySelectorAll('#history_rows code')].map((one) => one.textContent)`);
  expect(commands.some((one) => one.startsWith('anigen-rig worm.obj')), 'history has no command of the mesh');
  await picture(user, 'studio_history.png');
  await user.click('#close_history');
}

async function onPhone(browser, address, job) {
  const page = await Page.open(browser, `${address}#${job.id}`, kScreens.phone, (url) => url.startsWith(address)), user = new User(page, address);
  await user.until(`document.body.dataset.shown !== undefined`, 'the page on a phone');
  for (const tab of ['export', 'pose', 'edit', 'view']) {
    await user.open(tab);
    await page.checkWidth();
  }
  await user.value(`document.getElementById('tabs').scrollIntoView()`);
  await pause(pictures ? 4000 : 300);
  await user.picture(path.join(folder, 'studio_phone.png'));
  return page.problems.map((problem) => 'phone: ' + problem);
}

mkdirSync(folder, {recursive: true});
const work = mkdtempSync(path.join(os.tmpdir(), 'anigen-studio-'));
const worm = path.join(work, 'worm.obj'), bvh = path.join(work, 'wave.bvh'), image = path.join(work, 'again.png');
writeFileSync(worm, wormObj());
writeFileSync(bvh, waveBvh());
copyFileSync(path.join(source, 'examples/creatures/deer.png'), image);
let studio, browser, page, failed = false, skipped = false;
try {
  studio = await startStudio(program, path.join(work, 'jobs'));
  const {address} = studio;
  if (!(await (await fetch(address + 'v1/studio')).json()).three) {
    console.log('not supported: three.js is not installed');
    skipped = true;
  } else {
    browser = new Browser(browserFile, path.join(work, 'profile'));
    page = await Page.open(browser, address, kScreens.desktop, (url) => url.startsWith(address));
    const user = new User(page, address);
    await user.until(`document.body.dataset.ready === 'yes'`, 'the page');
    await user.until(`performance.getEntriesByType('paint').length > 0`, 'the first paint');
    say(`first paint after ${Math.round(await user.value(`performance.getEntriesByType('paint')[0].startTime`))} ms`);
    const generates = (await jobsOf(address)).length > 0;
    const job = await riggedMesh(user, worm, work);
    await ownMotion(user, job, bvh);
    await pose(user);
    await edit(user, job);
    await exports(user, job);
    await check(user, path.join(folder, 'rigged.glb'));
    await compare(user);
    const deer = generates ? await images(user, image) : job;
    await history(user);
    await page.checkWidth();
    const problems = [...page.problems.filter((problem) => !kRefused.test(problem)), ...await onPhone(browser, address, pictures ? deer : job)];
    for (const problem of problems) console.error(problem);
    failed = problems.length > 0;
    say(`${problems.length} problems`);
  }
} catch (error) {
  console.error(String(error?.stack ?? error));
  for (const problem of page?.problems ?? []) console.error(problem);
  await page?.picture(path.join(folder, 'failed.png')).catch(() => {});
  failed = true;
}
browser?.child.kill('SIGKILL');
if (studio !== undefined) {
  const problem = await stopStudio(studio);
  if (problem !== '') failed = true, console.error(problem);
}
await pause(300);
if (existsSync(work)) rmSync(work, {recursive: true, force: true, maxRetries: 5});
process.exit(failed ? 1 : skipped ? 77 : 0);
