// Controls of the rig editor: joints, names, brush, and new weights by the studio while joints move.
import {$, chosenJob, element, fail, guarded, post, state} from '/base.js';
import {playClip, clipName, showClips} from '/motions.js';

let binding, wanted;  // promise of bindAll() while it runs; id of the job whose rig it is to bind next
let drafting = false, turn = 0;

const editor = () => state.editor;

// The request to the studio. The rig keeps its own weights while its joints are the rig's.
function wish(more) {
  const {joints, strokes, kept} = editor();
  const rows = joints.map(({name, parent, position, was}) => ({name, parent, position, ...(kept && was !== name ? {was} : {})}));
  return {joints: rows, method: kept ? 'keep' : $('binding').value, ...(strokes.length > 0 ? {strokes} : {}), ...more};
}

// New weights while a joint is dragged or a stroke painted: not kept, and without motions.
async function draft() {
  if (!$('follow').checked || drafting || binding) return;
  drafting = true;
  const mine = ++turn;
  try {
    const answer = await post(`/v1/jobs/${state.chosen}/rebind`, wish({draft: true}));
    const bytes = await answer.arrayBuffer();
    if (mine !== turn || !editor().active) return;
    if (!await state.stage.show(bytes, {keepView: true, still: () => editor().active})) return;
    editor().rebound();
    $('bound').textContent = `weights follow: ${answer.headers.get('x-bind-milliseconds')} ms`;
    document.body.dataset.drafts = Number(document.body.dataset.drafts ?? 0) + 1;
  } catch (problem) {
    fail(problem);
  } finally {
    drafting = false;
  }
}

// Binds the rig as it is edited now; further wishes meanwhile become one more round. Gives true once the stage shows the
// last of them, and otherwise when it failed, or when the stage went on to something else.
function rebind() {
  wanted = state.chosen;
  return binding ??= guarded(bindAll)().finally(() => binding = undefined);
}

async function bindAll() {
  let shown = false;
  try {
    while (wanted !== undefined && wanted === state.chosen && editor().active) {
      const of = wanted, started = performance.now();
      wanted = undefined;
      ++turn;
      $('bound').textContent = 'binding …';
      const answer = await post(`/v1/jobs/${of}/rebind`, wish());
      const bytes = await answer.arrayBuffer();
      const all = Math.round(performance.now() - started);
      shown = of === state.chosen && editor().active && await showEdited(of, bytes);
      if (shown) $('bound').textContent = `bound in ${answer.headers.get('x-bind-milliseconds')} ms, ${all} ms with motions and transfer`;
    }
  } catch (problem) {
    $('bound').textContent = '';
    throw problem;
  }
  return shown;
}

// Puts an edited rig of the same joints on the stage. Gives false when the stage has gone on to something else.
async function showEdited(of, bytes) {
  const job = chosenJob();
  job.edited = true;
  state.shown = `${of}/edited`;
  if (!await state.stage.show(bytes, {keepView: true})) return false;
  if (editor().active) editor().rebound();
  showClips();
  document.body.dataset.shown = state.shown;
  keep(job);
  return true;
}

// Edits that keep the rig's own weights are saved at once: binding anew, the other way to save, would lose these.
const follow = () => $('follow').checked || editor().kept ? rebind() : undefined;

// Names of a preset for all joints; the studio knows which joint is which. Nothing can be edited until they are there: an
// edit meanwhile would stand before their step of the history.
const renameAll = guarded(async () => {
  hold(true);
  try {
    await nameAll();
  } finally {
    hold(false);
  }
});

function hold(held) {
  editor().hold(held);
  $('edit_tools').disabled = held;
}

async function nameAll() {
  const of = state.chosen;
  if (editor().past.length > 0 && !await rebind()) return;
  const bytes = await (await post(`/v1/jobs/${of}/rename`, {names: $('preset').value})).arrayBuffer();
  if (of !== state.chosen || !editor().active) return;
  const before = editor().joints;
  if (!await showEdited(of, bytes) || !editor().active) return;
  const after = state.stage.joints();
  const far = (a, b) => Math.hypot(...a.map((v, i) => v - b[i]));
  const names = before.map(({position}) => after.reduce((best, joint) => far(joint.position, position) < far(best.position, position) ? joint : best).name);
  editor().renameAll(new Set(names).size === names.length ? names : after.map((joint) => joint.name));
  editor().paint();
  $('bound').textContent = 'renamed';
}

export function showEditor() {
  const {joints, chosen, past, undone, merging} = editor(), has = chosen >= 0;
  $('undo').disabled = past.length === 0;
  $('redo').disabled = undone.length === 0;
  for (const id of ['add_joint', 'merge_joint', 'mirror_joint', 'centre_joint', 'delete_joint', 'joint_name']) $(id).disabled = !has;
  $('merge_joint').setAttribute('aria-pressed', String(merging));
  $('joint_name').value = joints[chosen]?.name ?? '';
  const names = joints.map((joint) => joint.name).join('\n');
  if ($('joint_choice').dataset.of !== names) {
    $('joint_choice').dataset.of = names;
    $('joint_choice').replaceChildren(element('option', {value: '-1', textContent: 'none'}),
                                      ...joints.map((joint, j) => element('option', {value: String(j), textContent: joint.name})));
  }
  $('joint_choice').value = String(chosen);
}

// Edits are kept in the browser, so that strokes go on after a reload.
const keyOf = (job) => `edit ${job.id} ${job.created}`;

function keep(job) {
  try {
    localStorage.setItem(keyOf(job), editor().snapshot());
  } catch {
    // Without a place for it only strokes are forgotten, at the next reload.
  }
}
function kept(job) {
  try {
    return localStorage.getItem(keyOf(job)) ?? undefined;
  } catch {
    return undefined;
  }
}

export function openEditor() {
  const job = chosenJob();
  $('bound').textContent = '';
  editor().open(job.edited ? kept(job) : undefined);
  if (job.edited && kept(job) === undefined) editor().kept = false;
  showEditor();
}
export function closeEditor() {
  editor().close();
  $('tool_move').checked = true;
  showTools();
  state.stage.play(clipName());
}

function showTools() {
  $('brush_tools').hidden = !$('tool_paint').checked;
  $('joint_tools').hidden = $('tool_paint').checked;
}

export const editorActions = {changed: showEditor, moving: draft, dropped: () => { showEditor(); follow(); }};
export const brushActions = {
  settings: () => ({radius: Number($('brush_radius').value) / 100, strength: Number($('brush_strength').value) / 100, mode: $('brush_mode').value}),
  painting: draft,
  painted: () => { showEditor(); rebind(); },
  refuse: fail,
};

const kArrows = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};
const kStep = 0.01;  // of the mesh's size

function addKeys() {
  document.addEventListener('keydown', (event) => {
    if (state.tab !== 'edit' || !editor()?.active || editor().held) return;
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === 'z') {
      event.preventDefault();
      $(event.shiftKey ? 'redo' : 'undo').click();
    } else if (kArrows[event.key] && event.target === state.stage.renderer.domElement) {
      event.preventDefault();
      const [right, up] = kArrows[event.key], step = event.shiftKey ? 5 * kStep : kStep;
      if (editor().nudge(right * step, up * step)) follow();
    } else if (event.key === 'Delete' && event.target === state.stage.renderer.domElement) {
      $('delete_joint').click();
    }
  });
}

export function startEditor() {
  const edit = (id, action) => $(id).addEventListener('click', guarded(async () => {
    if (action() === false) return;
    showEditor();
    await follow();
  }));
  edit('undo', () => editor().undo());
  edit('redo', () => editor().redo());
  edit('add_joint', () => editor().add());
  edit('delete_joint', () => editor().delete());
  edit('mirror_joint', () => editor().mirror());
  edit('centre_joint', () => editor().centre());
  $('merge_joint').addEventListener('click', () => {
    editor().merging = !editor().merging;
    showEditor();
  });
  $('joint_choice').addEventListener('change', () => {
    const joint = Number($('joint_choice').value);
    if (editor().merging) editor().take(joint);
    else editor().choose(joint);
  });
  $('joint_name').addEventListener('change', guarded(async () => {
    if (editor().rename($('joint_name').value.trim())) await follow();
  }));
  $('preset').append(...(state.studio.names ?? []).map((word) => element('option', {value: word, textContent: word})));
  $('rename_all').addEventListener('click', renameAll);
  $('rebind').addEventListener('click', () => {
    editor().kept = false;
    rebind();
  });
  $('snap').addEventListener('change', () => editor().snaps = $('snap').checked);
  for (const id of ['tool_move', 'tool_paint']) $(id).addEventListener('change', () => {
    editor().setPainting($('tool_paint').checked);
    showTools();
  });
  addKeys();
}
