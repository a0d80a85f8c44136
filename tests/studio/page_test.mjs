// Parts of the page of anigen-studio that need no browser: edits of joints, command lines of jobs, the list of jobs.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import path from 'node:path';
import {fileURLToPath} from 'node:url';

const page = path.resolve(path.dirname(fileURLToPath(import.meta.url)), '../../anigen/studio/page');
const load = (name) => import('data:text/javascript,' + encodeURIComponent(readFileSync(path.join(page, name), 'utf8')));
const {addedChild, deleted, freeName, merged, mirrored, otherSide} = await load('joint_edits.js');
const {commandOf, settingsOf} = await load('commands.js');

const joint = (name, parent, ...position) => ({name, parent, position});
const body = () => [joint('root', -1, 0, 1, 0), joint('chest', 0, 0, 2, 0), joint('arm_L', 1, 1, 2, 0), joint('hand_L', 2, 2, 2, 0), joint('head', 1, 0, 3, 0)];
const parentNames = (joints) => Object.fromEntries(joints.map(({name, parent}) => [name, parent < 0 ? '' : joints[parent].name]));

// The name of the other side keeps its style.
assert.equal(otherSide('arm_L'), 'arm_R');
assert.equal(otherSide('RightArm'), 'LeftArm');
assert.equal(otherSide('tail'), 'tail_mirrored');
assert.equal(freeName(body(), 'chest'), 'chest_2');

// A child goes on in the direction of its bone.
{
  const {joints, chosen} = addedChild(body(), 3, 4);
  assert.deepEqual(joints[chosen], joint('hand_L_child', 3, 2.5, 2, 0));
  assert.equal(addedChild(body(), -1, 4), undefined);
  const [x, y, z] = addedChild([joint('only', -1, 0, 0, 0)], 0, 4).joints[1].position;
  assert.ok(x === 0 && y > 0 && z === 0);
}

// Children of a deleted joint go to the one above; the root needs one child.
{
  const {joints, chosen} = deleted(body(), 1);
  assert.deepEqual(parentNames(joints), {root: '', arm_L: 'root', hand_L: 'arm_L', head: 'root'});
  assert.equal(joints[chosen].name, 'root');
  assert.deepEqual(parentNames(deleted(body(), 0).joints), {chest: '', arm_L: 'chest', hand_L: 'arm_L', head: 'chest'});
  assert.equal(deleted([joint('root', -1, 0, 0, 0), joint('a', 0, 1, 0, 0), joint('b', 0, 2, 0, 0)], 0), undefined);
}

// Two joints become one in the middle, whichever was chosen first; the one nearer to the root keeps its name.
for (const [a, b] of [[1, 3], [3, 1]]) {
  const {joints, chosen, renamed, keeps} = merged(body(), a, b);
  assert.equal(keeps, false);  // the hand's parent is the arm
  assert.deepEqual(parentNames(joints), {root: '', chest: 'root', arm_L: 'chest', head: 'chest'});
  assert.deepEqual(joints[chosen], joint('chest', 0, 1, 2, 0));
  assert.equal(renamed.get('hand_L'), 'chest');
}
assert.deepEqual(parentNames(merged(body(), 4, 2).joints), {root: '', chest: 'root', hand_L: 'head', head: 'chest'});
assert.equal(merged(body(), 2, 3).keeps, true);
assert.equal(merged(body(), 2, 2), undefined);

// A joint that the other side lacks is added, under its twin or the same joint of the middle.
{
  const {joints, chosen} = mirrored(body(), 2, 4);
  assert.equal(parentNames(joints).arm_R, 'chest');
  assert.equal(parentNames(joints).hand_R, 'arm_R');
  assert.deepEqual(joints[chosen].position, [-1, 2, 0]);
  // Once more: what is there moves.
  const moved = joints.map((one) => one.name === 'hand_L' ? {...one, position: [2, 5, 0]} : one), again = mirrored(moved, 2, 4);
  assert.equal(again.joints.length, joints.length);
  assert.deepEqual(again.joints.find((one) => one.name === 'hand_R').position, [-2, 5, 0]);
}

// Edits leave the list that they were given as it was.
{
  const before = body(), text = JSON.stringify(before);
  for (const edit of [addedChild(before, 1, 4), deleted(before, 1), merged(before, 1, 2), mirrored(before, 1, 4)]) assert.ok(edit);
  assert.equal(JSON.stringify(before), text);
}
// Command lines have the settings of the job, and words that a shell would split in quotes.
assert.equal(commandOf({kind: 'generation', name: 'my deer.png', names: {file: 'my deer.png'}, options: {seed: 7, ss_steps: 9}}),
             "anigen-generate 'my deer.png' --seed 7 --ss-steps 9 -o 'my deer'");
assert.equal(commandOf({kind: 'generation', name: 'a.png', names: {mask: 'mask.png'}, options: {stop_at: 'voxels'}}),
             'anigen-generate a.png --seed 42 --mask mask.png --stop-at voxels -o a');
assert.equal(commandOf({kind: 'rig', name: "it's.obj", options: {method: 'auto', symmetric: true, templates: ['fox', 'horse'], keep_skeleton: false}}),
             "anigen-rig 'it'\\''s.obj' --method auto --template fox --template horse --symmetric --new-skeleton -o 'it'\\''s_rigged.glb'");
assert.equal(commandOf({kind: 'animation', name: 'fox.glb', names: {motion: 'run.bvh'}, options: {motions: ['idle'], travel: true}}),
             'anigen-animate fox.glb --motion idle --motion run.bvh --travel --fps 24 -o fox_animated.glb');
assert.equal(commandOf({kind: 'evaluation', name: 'fox.glb', names: {truth: 'true.glb'}, options: {}}),
             'anigen-eval --pred fox.glb -d true.glb --metrics skeleton,transport,skin,surface -o fox_scores');
assert.equal(settingsOf({kind: 'rig', options: {method: 'curve', joints: 20, symmetric: true}}), 'method curve, joints 20, symmetric');

// A list that was on its way when a job was sent does not lack that job in the page: it stays chosen.
{
  const urlOf = (text) => 'data:text/javascript,' + encodeURIComponent(text);
  const read = (name) => readFileSync(path.join(page, name), 'utf8');
  const base = urlOf(read('base.js'));
  globalThis.window = {addEventListener() {}};
  globalThis.document = {getElementById: () => ({})};
  const answers = [[{id: 'a', state: 'done'}], [{id: 'a', state: 'done'}, {id: 'b', state: 'done'}]];
  let asked = 0;
  globalThis.fetch = async () => {
    const jobs = answers[Math.min(asked++, 1)];
    await new Promise((resolve) => setTimeout(resolve, 20));
    return {ok: true, json: async () => ({jobs})};
  };
  const {state, listen} = await import(base);
  const {look} = await import(urlOf(read('events.js').replaceAll("'/base.js'", JSON.stringify(base))));
  const chosen = [];
  listen('jobs', () => chosen.push(state.chosen));
  const first = look();
  state.chosen = 'b';
  await Promise.all([first, look()]);
  assert.deepEqual([asked, chosen, state.chosen], [2, ['b'], 'b']);
}

// A rig whose file is read late, when another one or none is to be shown, stays off the stage.
{
  const anything = new Proxy(function () {}, {
    get: (_, key) => key === Symbol.toPrimitive ? () => 0 : anything,
    set: () => true,
    apply: () => anything,
    construct: () => anything,
  });
  const read = {};
  class GLTFLoader {
    parseAsync(name) {
      return new Promise((resolve) => read[name] = () => resolve({scene: {name, traverse() {}, updateMatrixWorld() {}}, animations: []}));
    }
  }
  globalThis.stubs = {THREE: anything, OrbitControls: anything, GLTFLoader};
  globalThis.ResizeObserver = class { observe() {} };
  const text = readFileSync(path.join(page, 'viewer.js'), 'utf8').replace(/^import .*;$/gm, '');
  const {Stage} = await import('data:text/javascript,' + encodeURIComponent('const {THREE, OrbitControls, GLTFLoader} = stubs;' + text));
  const stage = new Stage({append() {}, clientWidth: 0, clientHeight: 0});
  const shown = [];
  const show = (name, options) => stage.show(name, options).then((is) => shown.push([name, is, stage.model?.name]));
  const first = show('first'), second = show('second');
  read.second();
  await second;
  read.first();
  await first;
  const third = show('third');
  stage.clear();
  read.third();
  await third;
  const fourth = show('fourth');
  read.fourth();
  await fourth;
  const fifth = show('fifth', {still: () => false});
  read.fifth();
  await fifth;
  assert.deepEqual(shown, [['second', true, 'second'], ['first', false, 'second'], ['third', false, undefined],
                           ['fourth', true, 'fourth'], ['fifth', false, 'fourth']]);
}
console.log('edits of joints, command lines, the list of jobs and the stage: as they should be');
process.exit();  // the page goes on looking for jobs
