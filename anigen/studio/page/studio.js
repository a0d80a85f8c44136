// The page of anigen-studio: starts its parts, and shows the job that is chosen in one of the views that suit it.
import {$, ask, askJson, chosenJob, element, fail, fileOf, guarded, hasRig, isActive, latestOf, listen, state} from '/base.js';
import {showFindings, showScores, startCheck} from '/check_panel.js';
import {commandOf} from '/commands.js';
import {closeComparison, startComparison} from '/compare_panel.js';
import {startDoors} from '/doors.js';
import {brushActions, closeEditor, editorActions, openEditor, startEditor} from '/edit_panel.js';
import {look} from '/events.js';
import {showExport} from '/export_panel.js';
import {startHistory} from '/history.js';
import {startJobList} from '/job_list.js';
import {startMaskBrush} from '/mask_brush.js';
import {showClips, startMotions} from '/motions.js';
import {closePose, openPose, poseActions, startPose} from '/pose_panel.js';
import {startSteps} from '/steps.js';

const kTabs = {steps: 'Steps', view: 'View', pose: 'Pose', edit: 'Edit', compare: 'Compare', check: 'Check', export: 'Export'};
const kMotions = ['view', 'compare'];  // views in which clips are chosen

let loading;

// Views that suit a job.
function tabsOf(job) {
  if (hasRig(job)) return Object.keys(kTabs).filter((tab) => tab !== 'steps' || job.kind === 'generation');
  return job.kind === 'evaluation' && job.state === 'done' ? ['steps', 'check'] : ['steps'];
}

// three.js and what needs it; it takes a while, so the page begins with it before there is anything to show.
function load3d() {
  return loading ??= Promise.all(['/viewer.js', '/rig_editor.js', '/weight_brush.js', '/pose.js'].map((path) => import(path)));
}

async function ready3d() {
  if (!state.studio.three) throw new Error('no 3D view: three.js was not found where the studio runs (npm install three)');
  const [{Stage}, {RigEditor}, {WeightBrush}, {Poser}] = await load3d();
  if (state.stage) return;
  state.stage = new Stage($('stage'));
  state.editor = new RigEditor(state.stage, editorActions);
  state.brush = new WeightBrush(state.stage, state.editor, brushActions);
  state.poser = new Poser(state.stage, poseActions);
  window.studio = state;  // for the console, and for tests
}

function addTabs() {
  $('tabs').append(...Object.entries(kTabs).map(([tab, title]) => {
    const made = element('button', {type: 'button', textContent: title});
    made.dataset.tab = tab;
    made.setAttribute('role', 'tab');
    made.id = 'tab_' + tab;
    made.setAttribute('aria-controls', 'panel_' + tab);
    const panel = document.querySelector(`[data-panel=${tab}]`);
    panel.id ||= 'panel_' + tab;
    panel.setAttribute('role', 'tabpanel');
    panel.setAttribute('aria-labelledby', made.id);
    made.addEventListener('click', guarded(() => openTab(tab)));
    return made;
  }));
  $('tabs').addEventListener('keydown', (event) => {
    const step = {ArrowRight: 1, ArrowLeft: -1}[event.key];
    if (step === undefined) return;
    const there = [...$('tabs').children].filter((one) => !one.hidden), at = there.indexOf(document.activeElement);
    const next = there[(at + step + there.length) % there.length];
    next.focus();
    next.click();
  });
}

function leaveTab(wanted) {
  if (state.tab === 'edit' && wanted !== 'edit' && state.editor?.active) closeEditor();
  if (state.tab === 'pose' && wanted !== 'pose' && state.poser?.active) closePose();
  if (state.tab === 'compare' && wanted !== 'compare') closeComparison();
}

async function openTab(wanted) {
  const job = chosenJob(), again = wanted === state.tab && (state.editor?.active || state.poser?.active);
  leaveTab(wanted);
  state.tab = wanted;
  document.body.dataset.tab = wanted;
  for (const one of $('tabs').children) {
    one.hidden = !tabsOf(job).includes(one.dataset.tab);
    one.setAttribute('aria-selected', String(one.dataset.tab === wanted));
    one.tabIndex = one.dataset.tab === wanted ? 0 : -1;
  }
  $('tabs').hidden = false;
  for (const panel of document.querySelectorAll('.panel')) panel.hidden = panel.dataset.panel !== wanted;
  const rig = state.shown !== undefined;
  $('stage').hidden = !rig || wanted === 'steps';
  $('play_bar').hidden = $('clips').hidden = !rig || !kMotions.includes(wanted);
  if (wanted === 'view') showNotes(job);
  if (!state.stage?.model || again) return;
  if (wanted === 'edit') openEditor();
  if (wanted === 'pose') openPose();
  if (wanted === 'check') await showFindings();
  if (wanted === 'export') await showExport();
}

function showNotes(job) {
  $('note_box').hidden = !job.note;
  $('note').replaceChildren(...(job.note ?? '').split('; ').map((text) => element('li', {textContent: text})));
  $('command').textContent = commandOf(job);
  $('command_line').hidden = commandOf(job) === '';
}

let wasShown;  // job, state and file that the page was last laid out for

function forget() {
  if (state.editor?.active) state.editor.close();
  if (state.poser?.active) state.poser.close();
  closeComparison();
  state.stage?.clear();
  state.shown = undefined;
  delete document.body.dataset.shown;
}

async function showChosen() {
  state.chosen ??= state.jobs.filter((one) => one.state === 'done').at(-1)?.id ?? state.jobs.find(isActive)?.id;
  if (state.chosen !== undefined && location.hash !== '#' + state.chosen) history.replaceState(null, '', '#' + state.chosen);
  const job = chosenJob(), file = hasRig(job) ? `${job.id}/${latestOf(job)}` : undefined;
  const is = job && `${job.id} ${job.state} ${file}`;
  if (is === wasShown || (file !== undefined && file === state.shown)) return void (wasShown = is);
  wasShown = is;
  forget();
  $('welcome').hidden = job !== undefined;
  if (job === undefined) {
    $('tabs').hidden = $('stage').hidden = $('play_bar').hidden = $('clips').hidden = true;
    for (const panel of document.querySelectorAll('.panel')) panel.hidden = true;
    return;
  }
  state.shown = file;
  await openTab(file ? 'view' : tabsOf(job).at(-1));
  if (job.kind === 'evaluation') showScores(job);
  if (file === undefined) return;
  await ready3d();
  const bytes = await (await ask(fileOf(job, latestOf(job) + '.glb'))).arrayBuffer();
  if (state.shown !== file) return;
  if (!await state.stage.show(bytes)) return;
  showClips({another: true});
  if (state.tab !== 'view') await openTab(state.tab);
  document.body.dataset.shown = file;
}

try {
  state.studio = await askJson('/v1/studio');
  if (state.studio.three) load3d().catch(() => {});  // ready3d() says what is wrong
  $('version').textContent = state.studio.version;
  state.chosen = location.hash.slice(1) || undefined;  // after a reload
  addTabs();
  startDoors();
  listen('jobs', () => showChosen().catch(fail));  // first: it chooses
  startJobList();
  startSteps();
  startMotions();
  startMaskBrush();
  startEditor();
  startPose();
  startComparison();
  startCheck();
  startHistory();
  await look();
} catch (problem) {
  fail(problem);
}
document.body.dataset.ready = 'yes';
