// The steps of a job: pictures as they come, progress with time left, cancel; of an image also its mask to correct, and
// voxels of several seeds side by side.
import {$, ask, button, chosenJob, element, fileOf, guarded, hasRig, isActive, listen, state, titleOf} from '/base.js';
import {submit} from '/doors.js';
import {look} from '/events.js';
import {choose, progressOf, stateText} from '/job_list.js';
import {openMask} from '/mask_brush.js';

const kTitles = {input: 'image', mask: 'mask', normals: 'normals', voxels: 'voxels', votes: 'votes for joints'};

// The image of a job as a file, for another one.
async function imageOf(job) {
  const bytes = await (await ask(fileOf(job, 'input'))).blob();
  return new File([bytes], job.name);
}
// The mask that a job was given; undefined: none.
async function givenMask(job) {
  if (job.names?.mask === undefined) return undefined;
  const bytes = await (await ask(fileOf(job, 'mask.png'))).blob();
  return new File([bytes], 'mask.png', {type: 'image/png'});
}

// Options of a job without those that say where it begins and ends.
function plainOptions({options}) {
  const {stop_at, voxels_of, ...rest} = options;
  return rest;
}

// Jobs of one image: same name.
const family = (job) => state.jobs.filter((one) => one.kind === 'generation' && one.name === job.name);

const anotherSeed = guarded(async () => {
  const job = chosenJob(), seeds = family(job).map((one) => one.options.seed ?? 42);
  const options = {...plainOptions(job), seed: Math.max(...seeds) + 1, stop_at: 'voxels'};
  await submit('generations', {file: await imageOf(job), mask: await givenMask(job), options});
});

const goOn = (job) => guarded(() => submit('generations', {options: {...plainOptions(job), voxels_of: job.id}}));

const correctMask = guarded(async () => {
  const job = chosenJob(), {voxels_of, ...options} = job.options, known = (job.pictures ?? []).includes('mask') ? fileOf(job, 'mask.png') : undefined;
  const mask = await openMask(fileOf(job, 'input'), known);
  if (mask === undefined) return;
  await submit('generations', {file: await imageOf(job), mask, options});
});

function figure(source, caption, ...more) {
  return element('figure', {}, element('img', {src: source, alt: caption}), element('figcaption', {}, caption, ...more));
}

function showPictures(job) {
  const names = job.kind === 'generation' ? ['input', ...job.pictures ?? []] : [];
  const text = job.id + names.join();
  if ($('pictures').dataset.of === text) return;
  $('pictures').dataset.of = text;
  $('pictures').replaceChildren(...names.map((name) => figure(fileOf(job, name === 'input' ? name : name + '.png'), kTitles[name] ?? name)));
}

function showSeeds(job) {
  const all = job.kind === 'generation' ? family(job).filter((one) => (one.pictures ?? []).includes('voxels')) : [];
  const text = all.map((one) => one.id + one.state).join() + state.chosen;
  $('seeds_box').hidden = all.length < 2 && !(all.length === 1 && !hasRig(all[0]));
  if ($('seeds').dataset.of === text) return;
  $('seeds').dataset.of = text;
  $('seeds').replaceChildren(...all.map((one) => {
    const made = figure(fileOf(one, 'voxels.png'), `seed ${one.options.seed ?? 42}${one.names?.mask ? ', own mask' : ''}`);
    made.classList.toggle('chosen', one.id === state.chosen);
    if (hasRig(one)) made.lastChild.append(' ', button('Show', () => choose(one.id)));
    else if (one.state === 'done') made.lastChild.append(' ', button('Go on with this', goOn(one), {className: 'main go_on'}));
    return made;
  }));
}

function showActions(job) {
  const text = job.id + job.state;
  if ($('step_actions').dataset.of === text) return;
  $('step_actions').dataset.of = text;
  const actions = [];
  if (isActive(job)) {
    actions.push(button('Cancel', guarded(async () => {
      await ask('/v1/jobs/' + job.id, {method: 'DELETE'});
      await look();
    })));
  }
  if (job.kind === 'generation') {
    actions.push(button('Correct the mask …', correctMask, {id: 'correct_mask'}),
                 button('Another seed', anotherSeed, {id: 'another_seed'}));
  }
  $('step_actions').replaceChildren(...actions);
}

function show() {
  const job = chosenJob();
  if (job === undefined) return;
  $('progress_line').textContent = `${titleOf(job)}: ${stateText(job)}`;
  $('progress').hidden = job.state !== 'running';
  $('progress').value = job.state === 'running' ? progressOf(job) : 0;
  showPictures(job);
  showActions(job);
  showSeeds(job);
}

export function startSteps() {
  listen('jobs', show);
  setInterval(() => { if (chosenJob()?.state === 'running') show(); }, 1000);
}
