// Motions of the rig that is shown: tiles with small moving pictures, and own motions of other files.
import {$, chosenJob, element, guarded, jobOf, listen, postForm, state} from '/base.js';
import {ended, look} from '/events.js';

const kFrames = 6, kSide = 72;  // pictures of a clip, and CSS pixels of each

const others = new Set();  // what else plays the clip that is chosen
let playing, wanted, run = 0;  // name of the clip; name to play once the rig with it is there; counter of drawSheets()

// A row of pictures along a clip (undefined: the rest pose), drawn by the stage in a corner of its own canvas, which it draws again at once.
function drawSheet(stage, clip, canvas) {
  const {renderer, camera, scene} = stage, before = [stage.action, stage.time], ratio = renderer.getPixelRatio();
  const view = camera.clone(), context = canvas.getContext('2d'), side = Math.floor(kSide * ratio);
  view.aspect = 1;
  view.position.copy(stage.homeView(1));
  view.lookAt(stage.centre);
  view.updateProjectionMatrix();
  const bones = stage.lines.group.visible;
  stage.lines.group.visible = false;
  stage.mixer.stopAllAction();
  stage.rested();
  const action = clip && stage.mixer.clipAction(clip).play();
  renderer.setScissorTest(true);
  renderer.setViewport(0, 0, kSide, kSide);
  renderer.setScissor(0, 0, kSide, kSide);
  for (let frame = 0; frame < kFrames; frame++) {
    if (clip) stage.mixer.setTime(clip.duration * frame / kFrames);
    stage.model.updateMatrixWorld(true);
    renderer.render(scene, view);
    context.drawImage(renderer.domElement, 0, renderer.domElement.height - side, side, side, frame * kSide, 0, kSide, kSide);
  }
  renderer.setScissorTest(false);
  renderer.setViewport(0, 0, stage.element.clientWidth, stage.element.clientHeight);
  action?.stop();
  stage.lines.group.visible = bones;
  if (before[0]) before[0].play(), stage.setTime(before[1]);
  stage.draw();
}

const idle = () => new Promise((resolve) => 'requestIdleCallback' in window ? requestIdleCallback(resolve, {timeout: 400}) : setTimeout(resolve, 60));

// Pictures for all tiles, one clip at a time, as long as this rig is shown in motion.
async function drawSheets() {
  const mine = ++run, shown = state.shown;
  for (const tile of [...$('clips').children]) {
    const clip = state.stage.clips.find((one) => one.name === tile.dataset.clip);
    await idle();
    while (['edit', 'pose'].includes(state.tab) && mine === run) await new Promise((resolve) => setTimeout(resolve, 300));
    if (mine !== run || shown !== state.shown || !state.stage.model) return;
    drawSheet(state.stage, clip, tile.querySelector('canvas'));
    tile.dataset.drawn = 'yes';
  }
}

export const clipName = () => playing;

export function playClip(name) {
  playing = name;
  for (const tile of $('clips').children) tile.setAttribute('aria-selected', String(tile.dataset.clip === (name ?? '')));
  if (!['edit', 'pose'].includes(state.tab)) state.stage.play(name);
  for (const action of others) action(name);
}
export const alsoPlay = (action) => { others.add(action); return () => others.delete(action); };

function tileOf(name, text) {
  const canvas = element('canvas', {width: kFrames * kSide, height: kSide});
  const tile = element('button', {type: 'button', className: 'clip', title: text}, element('span', {className: 'sheet'}, canvas),
                       element('span', {textContent: text}));
  tile.dataset.clip = name;
  tile.setAttribute('role', 'option');
  tile.addEventListener('click', () => playClip(name || undefined));
  return tile;
}

// The tiles of the rig on the stage. The clip that played goes on, where the rig has it, unless it is another rig.
export function showClips({another = false} = {}) {
  if (another) playing = undefined;
  const names = state.stage.clips.map((clip) => clip.name);
  const start = [wanted, playing, 'walk', 'fly', 'swim', 'idle'].find((word) => names.includes(word)) ?? names[0];
  if (names.includes(wanted)) wanted = undefined;
  $('clips').replaceChildren(...names.map((name) => tileOf(name, name)), tileOf('', 'rest pose'));
  playClip(start);
  drawSheets();
}

// A motion file for the rig that is shown: the studio puts it on the rig as a new job, which is shown next.
export const ownMotion = guarded(async (file) => {
  const of = chosenJob(), known = new Set(state.stage.clips.map((clip) => clip.name));
  $('retargeting').textContent = `${file.name} …`;
  try {
    const {id} = await postForm('/v1/3d/animations', {job: of.id, motion: file, options: {motions: []}});
    await look();
    const done = await ended(id);
    if (done?.state !== 'done') throw new Error(`${file.name}: ${done?.error || done?.state || 'the job is gone'}`);
    wanted = done.result.clips.find((name) => !known.has(name)) ?? done.result.clips.at(-1);
    if (state.chosen === of.id && jobOf(id)) {
      state.chosen = id;
      await look();
    }
  } finally {
    $('retargeting').textContent = '';
  }
});

export function startMotions() {
  listen('motion', ownMotion);
  $('own_motion').addEventListener('change', () => {
    const [file] = $('own_motion').files;
    if (file) ownMotion(file).then(() => $('own_motion').value = '');
  });
  $('clips').addEventListener('keydown', (event) => {
    const step = {ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1}[event.key];
    if (step === undefined) return;
    event.preventDefault();
    const tiles = [...$('clips').children], at = tiles.indexOf(document.activeElement);
    tiles[(at + step + tiles.length) % tiles.length].focus();
  });
  $('play').addEventListener('click', () => {
    const plays = $('play').textContent === 'Play';
    $('play').textContent = plays ? 'Pause' : 'Play';
    state.stage.playing = plays;
  });
}
