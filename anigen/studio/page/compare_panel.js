// One mesh rigged by several methods, side by side in one motion.
import {$, ask, chosenJob, element, fileOf, guarded, jobOf, latestOf, post, state} from '/base.js';
import {ended, look} from '/events.js';
import {alsoPlay, clipName} from '/motions.js';

let stages = [], silence = () => {};

export function closeComparison() {
  for (const other of stages) other.dispose();
  stages = [];
  silence();
  $('compare_stages').replaceChildren();
  $('compare_stages').hidden = true;
  $('comparing').textContent = '';
  $('stage').hidden = state.shown === undefined;
}

const captionOf = (job, base) => job === base ? job.name : `${job.options.method}: ${job.result.joints} joints, ${job.result.seconds.toFixed(1)} s`;

async function showSideBySide(jobs, base) {
  closeComparison();
  $('stage').hidden = true;
  $('compare_stages').hidden = false;
  const {Stage} = await import('/viewer.js'), began = performance.now();
  const places = jobs.map((job) => {
    const place = element('div', {className: 'canvas'});
    $('compare_stages').append(element('figure', {}, place, element('figcaption', {textContent: captionOf(job, base)})));
    return place;
  });
  for (const [i, job] of jobs.entries()) {
    const other = new Stage(places[i]);
    stages.push(other);
    const bytes = await (await ask(fileOf(job, latestOf(job) + '.glb'))).arrayBuffer();
    if (stages[i] !== other || !await other.show(bytes)) return;  // the comparison was closed
    other.showBones($('show_bones').checked);
    other.play(clipName());
    other.clock = () => state.stage.playing ? (performance.now() - began) / 1000 : other.time;
  }
  silence = alsoPlay((name) => { for (const other of stages) other.play(name); });
  document.body.dataset.compared = String(stages.length);
}

const compare = guarded(async () => {
  const methods = [...document.querySelectorAll('#methods input:checked')].map((box) => box.value);
  const of = state.chosen, base = chosenJob(), left = () => state.chosen !== of || state.tab !== 'compare';
  const made = (await (await post(`/v1/jobs/${of}/compare`, {methods})).json()).jobs.map(({id}) => id);
  $('comparing').textContent = 'rigging …';
  await look();
  await Promise.all(made.map((id) => ended(id, left)));
  if (left()) return;
  const jobs = made.map(jobOf).filter(Boolean), failed = jobs.filter((job) => job.state !== 'done');
  await showSideBySide([base, ...jobs.filter((job) => job.state === 'done')], base);
  $('comparing').textContent = failed.map((job) => `${job.options.method}: ${job.error || job.state}`).join('; ');
});

export function startComparison() {
  $('compare').addEventListener('click', compare);
  $('show_bones').addEventListener('change', () => {
    for (const one of [state.stage, ...stages]) one.showBones($('show_bones').checked);
  });
  $('methods').append(...state.studio.methods.filter((word) => word !== 'auto').map((word) => element(
      'label', {}, element('input', {type: 'checkbox', value: word, checked: ['curve', 'pinocchio', 'heat'].includes(word)}), ' ' + word)));
}
