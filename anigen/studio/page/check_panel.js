// Faults of a rig, and metrics against a true one.
import {$, chosenJob, element, guarded, post, postForm, state} from '/base.js';
import {ended, look} from '/events.js';

export const showFindings = guarded(async () => {
  $('findings').replaceChildren();
  $('scores').replaceChildren();
  $('score_notes').replaceChildren();
  const {findings} = await (await post(`/v1/jobs/${state.chosen}/lint`)).json();
  const lines = findings.map((finding) => element('li', {className: finding.severity, textContent: `${finding.severity}: ${finding.sentence}`}));
  $('findings').replaceChildren(...(lines.length > 0 ? lines : [element('li', {textContent: 'Nothing is wrong with this rig.'})]));
});

// Scores of a job of kind evaluation.
export function showScores({scores}) {
  $('scores').replaceChildren(...Object.entries(scores?.values ?? {}).map(
      ([key, value]) => element('tr', {}, element('th', {scope: 'row', textContent: key}), element('td', {textContent: Number(value).toPrecision(4)}))));
  const without = Object.entries(scores?.not_computed ?? {}).map(([key, why]) => `${key}: ${why}`);
  $('score_notes').replaceChildren(...[...scores?.notes ?? [], ...without].map((text) => element('li', {textContent: text})));
}

const evaluate = guarded(async () => {
  const [file] = $('truth').files, of = chosenJob();
  if (!file) return;
  $('evaluating').textContent = 'measuring …';
  try {
    const {id} = await postForm('/v1/3d/evaluations', {job: of.id, truth: file, options: {}});
    await look();
    const done = await ended(id);
    if (done?.state !== 'done') throw new Error(`metrics: ${done?.error || done?.state || 'the job is gone'}`);
    if (state.chosen === of.id) showScores(done);
  } finally {
    $('evaluating').textContent = '';
    $('truth').value = '';
  }
});

export function startCheck() { $('truth').addEventListener('change', evaluate); }
