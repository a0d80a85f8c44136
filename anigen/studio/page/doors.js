// New jobs: doors for images and meshes, settings, the gallery.
import {$, ask, button, element, fail, guarded, isActive, listen, postForm, state, tell} from '/base.js';
import {look} from '/events.js';

const isImage = (name) => /\.(png|jpe?g|webp|bmp|tiff?)$/i.test(name);
const isMotionOnly = (name) => /\.bvh$/i.test(name);

function imageOptions() {
  const options = {seed: Math.max(0, Math.floor(Number($('seed').value))) || 0};
  if (Number($('image_joints').value) > 0) options.joints = Number($('image_joints').value);
  if ($('stop_at_voxels').checked) options.stop_at = 'voxels';
  return options;
}

function meshOptions() {
  const options = {method: $('method').value, symmetric: $('symmetric').checked};
  const templates = [...document.querySelectorAll('#species input:checked')].map((box) => box.value);
  if (templates.length > 0 && ['auto', 'pinocchio'].includes(options.method)) options.templates = templates;
  if (Number($('joints').value) > 0) options.joints = Number($('joints').value);
  return options;
}

// Sets the settings to those of a job, for another run.
export function useSettings({kind, options}) {
  $('settings').open = true;
  if (kind === 'generation') {
    $('seed').value = options.seed ?? 42;
    $('image_joints').value = options.joints ?? 0;
    $('stop_at_voxels').checked = options.stop_at === 'voxels';
  } else {
    $('method').value = options.method ?? 'auto';
    $('symmetric').checked = options.symmetric ?? false;
    $('joints').value = options.joints ?? 0;
    for (const box of document.querySelectorAll('#species input')) box.checked = (options.templates ?? []).includes(box.value);
  }
  showSliders();
}

// Sends parts of a form as a new job, and shows that one.
export async function submit(route, parts) {
  const job = await postForm('/v1/3d/' + route, parts);
  state.chosen = job.id;
  await look();
  return job;
}

export const send = guarded(async (files) => {
  for (const file of files) {
    const most = state.studio.limits.bytes;
    if (file.size > most) throw new Error(`${file.name} is larger than ${most >> 20} MiB`);
    const image = isImage(file.name);
    await submit(image ? 'generations' : 'rigs', {file, options: image ? imageOptions() : meshOptions()});
  }
});

// Files that fell on the page: motions for the rig that is shown, when they can be nothing else or fell on it.
function take(files, onStage) {
  const motions = files.filter((file) => isMotionOnly(file.name) || (onStage && /\.(fbx|dae|glb|gltf)$/i.test(file.name)));
  if (motions.length > 0 && state.shown !== undefined) tell('motion', motions[0]);
  else if (motions.some((file) => isMotionOnly(file.name))) return fail('A motion needs a rig to play on: open one first.');
  else return void send(files);
  const others = files.filter((file) => !motions.includes(file));
  if (others.length > 0) send(others);
}

function addDoors() {
  for (const door of [$('image_door'), $('mesh_door')]) {
    const input = door.querySelector('input');
    input.addEventListener('change', () => { send([...input.files]).then(() => input.value = ''); });
  }
  const over = (is) => { for (const one of document.querySelectorAll('.door, #stage')) one.classList.toggle('over', is); };
  document.addEventListener('dragover', (event) => {
    event.preventDefault();
    over(true);
  });
  document.addEventListener('dragleave', (event) => { if (event.relatedTarget === null) over(false); });
  document.addEventListener('drop', (event) => {
    event.preventDefault();
    over(false);
    take([...event.dataTransfer.files], event.target.closest?.('#stage') !== null);
  });
  document.addEventListener('paste', (event) => {
    const files = [...event.clipboardData.files];
    if (files.length > 0) take(files, false);
  });
}

// The number beside a slider; 0 means that nothing is wished.
function showSliders() {
  for (const output of document.querySelectorAll('output[for]')) {
    const value = $(output.htmlFor.value).value;
    output.textContent = value === '0' ? 'as fit' : value;
  }
}

function addSettings() {
  $('method').append(...state.studio.methods.map((word) => element('option', {value: word, textContent: word})));
  $('species').append(...(state.studio.species ?? []).map((word) => element('label', {}, element('input', {type: 'checkbox', value: word}), ' ' + word)));
  $('image_joints_box').hidden = !state.studio.image_joints;
  document.addEventListener('input', (event) => { if (event.target.type === 'range') showSliders(); });
  showSliders();
}

// Example images. They stand open as long as nothing else was made.
function addGallery() {
  const names = state.studio.gallery;
  for (const file of names) {
    const name = file.replace('.png', '');
    const tile = button('', guarded(async () => {
      const image = await (await ask('/gallery/' + file)).blob();
      await send([new File([image], file, {type: 'image/png'})]);
    }), {title: 'Make ' + name});
    tile.append(element('img', {src: '/gallery/' + file, alt: name}));
    $('gallery').append(tile);
  }
  const show = () => {
    $('gallery_box').hidden = names.length === 0;
    $('gallery').classList.toggle('small', state.jobs.filter((job) => !isActive(job)).length > 1);
  };
  listen('jobs', show);
  show();
}

export function startDoors() {
  addDoors();
  addSettings();
  addGallery();
}
