// All jobs with settings, seed and the command line that repeats them.
import {$, button, element, guarded, listen, state, titleOf} from '/base.js';
import {commandOf, settingsOf} from '/commands.js';
import {useSettings} from '/doors.js';
import {choose, stateText} from '/job_list.js';

const timeOf = (job) => new Date(1000 * job.created).toLocaleString();

function rowOf(job) {
  const command = commandOf(job), close = () => $('history').close();
  const row = element('article', {}, element('h3', {textContent: titleOf(job)}),
                      element('p', {className: 'hint', textContent: `${job.kind}, ${timeOf(job)}: ${stateText(job)}`}));
  const settings = settingsOf(job);
  if (settings !== '') row.append(element('p', {textContent: settings}));
  if (command !== '') row.append(element('code', {textContent: command}));
  const bar = element('p', {className: 'bar'}, button('Show', () => { choose(job.id); close(); }));
  if (command !== '') {
    bar.append(button('Copy command', guarded(() => navigator.clipboard.writeText(command))));
  }
  if (['generation', 'rig'].includes(job.kind)) bar.append(button('Use settings', () => { useSettings(job); close(); }));
  row.append(bar);
  return row;
}

function show() {
  if (!$('history').open) return;
  const rows = [...state.jobs].reverse().map(rowOf);
  $('history_rows').replaceChildren(...(rows.length > 0 ? rows : [element('p', {className: 'hint', textContent: 'Nothing was made yet.'})]));
}

export function startHistory() {
  $('open_history').addEventListener('click', () => {
    $('history').showModal();
    show();
  });
  $('close_history').addEventListener('click', () => $('history').close());
  listen('jobs', () => { if (state.jobs.length !== document.querySelectorAll('#history_rows article').length) show(); });
}
