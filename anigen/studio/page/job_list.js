// The list of jobs: state, time left, cancel and remove.
import {$, ask, button, element, fileOf, guarded, hasRig, isActive, listen, spoken, state, tell, titleOf} from '/base.js';
import {look} from '/events.js';

const kDone = {generation: 'voxels', evaluation: 'scores'};  // of a job without a rig

export function stateText(job) {
  if (job.state === 'failed') return job.error;
  if (job.state === 'running') {
    const words = [job.stage || 'begins', spoken(Date.now() / 1000 - job.started)];
    if (job.seconds_left > 0) words.push(`about ${spoken(job.seconds_left)} left`);
    return words.join(', ');
  }
  if (job.state !== 'done') return job.state;
  const seconds = job.result.seconds === undefined ? '' : `, ${job.result.seconds.toFixed(1)} s`;
  return hasRig(job) ? `${job.result.joints} joints, ${job.result.faces} faces${seconds}` : (kDone[job.kind] ?? 'done') + seconds;
}

// Done of the whole, 0 … 1: by the time that is left where that is known, else of the stage.
export function progressOf(job) {
  const passed = Date.now() / 1000 - job.started;
  return job.seconds_left > 0 ? passed / (passed + job.seconds_left) : job.fraction;
}

function pictureOf(job) {
  if (hasRig(job)) return element('img', {src: fileOf(job, 'preview.png'), alt: ''});
  const newest = (job.pictures ?? []).at(-1);
  return newest ? element('img', {src: fileOf(job, newest + '.png'), alt: ''}) : element('span', {className: 'blank'});
}

export function choose(id) {
  state.chosen = id;
  tell('jobs');
  if (matchMedia('(max-width: 760px)').matches) $('work').scrollIntoView();
}

function rowOf(job) {
  const row = element('li', {tabIndex: 0});
  row.dataset.id = job.id;
  row.dataset.state = job.state;
  row.classList.toggle('chosen', job.id === state.chosen);
  row.setAttribute('aria-current', String(job.id === state.chosen));
  const text = isActive(job) ? 'Cancel' : 'Remove';
  const end = button(isActive(job) ? text : '×', guarded(async (event) => {
    event.stopPropagation();
    await ask('/v1/jobs/' + job.id, {method: 'DELETE'});
    await look();
  }), {title: text, ariaLabel: `${text} ${titleOf(job)}`});
  const said = element('span', {className: 'state', textContent: stateText(job)});
  said.classList.toggle('failed', job.state === 'failed');
  if (job.state === 'running') said.append(element('progress', {value: progressOf(job), max: 1}));
  row.append(pictureOf(job), element('span', {className: 'name', textContent: titleOf(job)}), end, said);
  row.addEventListener('click', () => choose(job.id));
  row.addEventListener('keydown', (event) => { if (event.key === 'Enter' && event.target === row) choose(job.id); });
  return row;
}

const rows = new Map();  // id → [text, row]: only rows that differ are made again, so that the focus stays

function show() {
  $('no_jobs').hidden = state.jobs.length > 0;
  const now = Math.round(Date.now() / 1000), list = [];
  for (const job of [...state.jobs].reverse()) {
    const text = JSON.stringify([job, job.id === state.chosen, job.state === 'running' ? now : 0]);
    if (rows.get(job.id)?.[0] !== text) rows.set(job.id, [text, rowOf(job)]);
    list.push(rows.get(job.id)[1]);
  }
  for (const id of [...rows.keys()]) if (!state.jobs.some((job) => job.id === id)) rows.delete(id);
  const there = [...$('jobs').children];
  if (there.length !== list.length || there.some((row, i) => row !== list[i])) $('jobs').replaceChildren(...list);
}

export function startJobList() {
  listen('jobs', show);
  setInterval(() => { if (state.jobs.some((job) => job.state === 'running')) show(); }, 1000);
}
