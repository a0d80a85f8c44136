// The page of anigen-studio: doors, jobs, and the views of the job that is chosen.
const $ = (id) => document.getElementById(id);
const kBusy = 500, kIdle = 3000;  // milliseconds between two looks at the jobs

let studio = {}, jobs = [], chosen, tab = 'view', three, stage, editor, compared = [], shownFile, timer;

function fail(problem) {
  $('failure').textContent = problem instanceof Error ? problem.message : String(problem);
  $('failure').hidden = false;
}
function calm() { $('failure').hidden = true; }

// Calls an action of the page, whose failure is shown.
function guarded(action) {
  return async (...words) => {
    try {
      calm();
      return await action(...words);
    } catch (problem) {
      fail(problem);
    }
  };
}

async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Error('the studio does not answer; was it stopped?');
  }
  if (answer.ok) return answer;
  const {error} = await answer.json().catch(() => ({}));
  throw new Error(error ?? `the studio answered with ${answer.status}`);
}
const post = (path, json) => ask(path, {method: 'POST', headers: {'content-type': 'application/json'}, body: JSON.stringify(json ?? {})});

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

// --- New jobs ---

const isImage = (name) => /\.(png|jpe?g|webp|bmp|tiff?)$/i.test(name);

function optionsFor(name) {
  if (isImage(name)) return {seed: Number($('seed').value) || 0};
  const options = {method: $('method').value, symmetric: $('symmetric').checked};
  if ($('species').value !== '') options.templates = [$('species').value];
  if (Number($('joints').value) > 0) options.joints = Number($('joints').value);
  return options;
}

const send = guarded(async (files) => {
  for (const file of files) {
    if (file.size > studio.most_bytes) throw new Error(`${file.name} is larger than ${studio.most_bytes >> 20} MiB`);
    const form = new FormData();
    form.append('file', file, file.name);
    form.append('options', JSON.stringify(optionsFor(file.name)));
    const job = await (await ask('/api/jobs', {method: 'POST', body: form})).json();
    chosen = job.id;
    shownFile = undefined;
  }
  await look();
});

function addDoors() {
  for (const door of [$('image_door'), $('mesh_door')]) {
    const input = door.querySelector('input');
    input.addEventListener('change', () => {
      send([...input.files]).then(() => input.value = '');
    });
  }
  document.addEventListener('dragover', (event) => {
    event.preventDefault();
    for (const door of document.querySelectorAll('.door')) door.classList.add('over');
  });
  const calmDoors = () => { for (const door of document.querySelectorAll('.door')) door.classList.remove('over'); };
  document.addEventListener('dragleave', (event) => { if (event.relatedTarget === null) calmDoors(); });
  document.addEventListener('drop', (event) => {
    event.preventDefault();
    calmDoors();
    send([...event.dataTransfer.files]);
  });
  document.addEventListener('paste', (event) => {
    const files = [...event.clipboardData.files];
    if (files.length > 0) send(files);
  });
}

function addGallery() {
  $('gallery_box').hidden = studio.gallery.length === 0;
  for (const name of studio.gallery) {
    const button = element('button', {type: 'button', title: name.replace('.png', '')},
                           element('img', {src: '/gallery/' + name, alt: name.replace('.png', '')}));
    button.addEventListener('click', guarded(async () => {
      const image = await (await ask('/gallery/' + name)).blob();
      await send([new File([image], name, {type: 'image/png'})]);
    }));
    $('gallery').append(button);
  }
}

// --- The list of jobs ---

const isActive = (job) => job.state === 'queued' || job.state === 'running';

function stateText(job) {
  if (job.state === 'running') return `${job.stage || 'begins'}, ${Math.round(Date.now() / 1000 - job.started)} s`;
  if (job.state === 'failed') return job.error;
  if (job.state === 'done') return `${job.result.joints} joints, ${job.result.faces} faces, ${job.result.seconds.toFixed(1)} s`;
  return job.state;
}

function rowOf(job) {
  const row = element('li', {tabIndex: 0});
  row.dataset.id = job.id;
  row.dataset.state = job.state;
  row.classList.toggle('chosen', job.id === chosen);
  row.append(job.state === 'done' ? element('img', {src: `/api/jobs/${job.id}/files/preview.png`, alt: ''})
                                  : element('span', {className: 'blank'}));
  row.append(element('span', {className: 'name', textContent: job.name}));
  const button = element('button', {type: 'button', textContent: isActive(job) ? 'Cancel' : '×', title: isActive(job) ? 'Cancel' : 'Remove'});
  button.addEventListener('click', guarded(async (event) => {
    event.stopPropagation();
    await (isActive(job) ? post(`/api/jobs/${job.id}/cancel`) : ask('/api/jobs/' + job.id, {method: 'DELETE'}));
    await look();
  }));
  row.append(button);
  const state = element('span', {className: 'state', textContent: stateText(job)});
  state.classList.toggle('failed', job.state === 'failed');
  if (job.state === 'running') state.append(element('progress', {value: job.fraction, max: 1}));
  row.append(state);
  const open = () => { chosen = job.id; shownFile = undefined; look(); };
  row.addEventListener('click', open);
  row.addEventListener('keydown', (event) => { if (event.key === 'Enter') open(); });
  return row;
}

let listed = '';
function showJobs() {
  $('no_jobs').hidden = jobs.length > 0;
  const text = JSON.stringify([jobs, chosen, jobs.some((j) => j.state === 'running') ? Math.round(Date.now() / 1000) : 0]);
  if (text === listed) return;
  listed = text;
  $('jobs').replaceChildren(...[...jobs].reverse().map(rowOf));
}

// Asks for the jobs, shows them, and asks again later: soon while one is at work.
async function look() {
  clearTimeout(timer);
  try {
    jobs = (await (await ask('/api/jobs')).json()).jobs;
    if (chosen === undefined) chosen = jobs.filter((job) => job.state === 'done').pop()?.id;
    if (!jobs.some((job) => job.id === chosen)) chosen = undefined;
    showJobs();
    await showChosen();
  } catch (problem) {
    fail(problem);
  }
  clearTimeout(timer);
  timer = setTimeout(look, jobs.some(isActive) ? kBusy : kIdle);
}

// --- The job that is chosen ---

const job = () => jobs.find((j) => j.id === chosen);
const latest = () => job().edited ? 'edited' : 'rigged';

async function ready3d() {
  if (!studio.three) throw new Error('no 3D view: three.js was not found where the studio runs (npm install three)');
  if (stage) return;
  three ??= Promise.all([import('/viewer.js'), import('/rig_editor.js')]);
  const [{Stage}, {RigEditor}] = await three;
  stage = new Stage($('stage'));
  editor = new RigEditor(stage, {changed: showEditor, moving: draft, dropped: () => { showEditor(); if ($('follow').checked) rebind(); }});
  window.studio = {stage, editor};  // for the console, and for tests
}

async function showChosen() {
  const one = job(), is = one?.state === 'done' ? `${one.id}/${latest()}` : undefined;
  if (is === shownFile) return;
  shownFile = is;
  editor?.close();
  closeComparison();
  stage?.clear();
  delete document.body.dataset.shown;
  $('tabs').hidden = $('play_bar').hidden = is === undefined;
  $('welcome').hidden = is !== undefined;
  for (const panel of document.querySelectorAll('.panel')) panel.hidden = true;
  if (is === undefined) return;
  showDownloads();
  await openTab('view');
  await ready3d();
  const bytes = await (await ask(`/api/jobs/${one.id}/files/${latest()}.glb`)).arrayBuffer();
  if (shownFile !== is) return;
  await stage.show(bytes);
  showClips();
  document.body.dataset.shown = is;
}

function showClips(wanted) {
  const names = stage.clips.map((clip) => clip.name);
  const start = names.includes(wanted) ? wanted : ['walk', 'fly', 'swim', 'idle'].find((word) => names.includes(word)) ?? names[0];
  $('clip').replaceChildren(...names.map((name) => element('option', {value: name, textContent: name, selected: name === start})),
                            element('option', {value: '', textContent: 'none (rest pose)', selected: start === undefined}));
  if (tab !== 'edit') stage.play(start);
}

// The command line that makes the rig of a job again, motions and edits aside.
function commandOf(one) {
  const quoted = (word) => /^[\w.+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`, stem = one.name.replace(/\.[^.]*$/, '');
  const {options} = one;
  if (one.kind === 'image') {
    const steps = ['ss_steps', 'slat_steps', 'joints'].filter((key) => options[key]).map((key) => ` --${key.replace('_', '-')} ${options[key]}`);
    return `anigen-generate ${quoted(one.name)} --seed ${options.seed ?? 42}${steps.join('')} -o ${quoted(stem)}`;
  }
  const words = [];
  for (const key of ['method', 'skin', 'joints', 'influences', 'names']) if (options[key]) words.push(`--${key} ${options[key]}`);
  for (const word of options.templates ?? []) words.push(`--template ${word}`);
  if (options.symmetric) words.push('--symmetric');
  if (options.keep_skeleton === false && (options.method ?? 'auto') === 'auto') words.push('--new-skeleton');
  return ['anigen-rig', quoted(one.name), ...words, '-o', quoted(`${stem}_rigged.glb`)].join(' ');
}

function showDownloads() {
  const one = job(), links = [];
  for (const form of one.edited ? ['edited', 'rigged'] : ['rigged']) {
    for (const format of ['glb', 'fbx', 'usdz'])
      links.push(element('a', {href: `/api/jobs/${one.id}/files/${form}.${format}`, download: '', textContent: `${form === 'edited' ? 'edited ' : ''}${format.toUpperCase()}`}));
  }
  $('downloads').replaceChildren('Download: ', ...links);
  $('note').textContent = one.note;
  $('command').textContent = commandOf(one);
}

async function openTab(wanted) {
  if (tab === 'edit' && wanted !== 'edit' && editor?.active) {
    editor.close();
    stage.play($('clip').value);
  }
  if (tab === 'compare' && wanted !== 'compare') closeComparison();
  tab = wanted;
  for (const button of document.querySelectorAll('#tabs button')) button.setAttribute('aria-selected', String(button.dataset.tab === tab));
  for (const panel of document.querySelectorAll('.panel')) panel.hidden = panel.dataset.panel !== tab;
  $('play_bar').hidden = tab === 'edit';
  if (tab === 'view') showDownloads();
  if (tab === 'edit' && stage?.model) editor.open(), showEditor();
  if (tab === 'check') await showFindings();
}

// --- Editing joints ---

function showEditor() {
  const has = editor.chosen >= 0, joint = has ? editor.joints[editor.chosen] : undefined;
  $('undo').disabled = editor.past.length === 0;
  $('redo').disabled = editor.undone.length === 0;
  $('add_joint').disabled = $('mirror_joint').disabled = $('centre_joint').disabled = $('delete_joint').disabled = $('joint_name').disabled = !has;
  $('joint_name').value = joint?.name ?? '';
}

let binding = false, again = false, drafting = false, turn = 0;

// New weights while a joint is being dragged: not kept, and without motions.
async function draft() {
  if (!$('follow').checked || drafting || binding) return;
  drafting = true;
  const mine = ++turn;
  try {
    const answer = await post(`/api/jobs/${chosen}/rebind`, {joints: editor.joints, method: $('binding').value, draft: true});
    const bytes = await answer.arrayBuffer();
    if (mine !== turn || !editor.active) return;
    await stage.show(bytes, {keepView: true});
    editor.rebound();
    $('bound').textContent = `weights follow: ${answer.headers.get('x-bind-milliseconds')} ms`;
    document.body.dataset.drafts = Number(document.body.dataset.drafts ?? 0) + 1;
  } catch (problem) {
    fail(problem);
  } finally {
    drafting = false;
  }
}

const rebind = guarded(async () => {
  if (binding) return void (again = true);
  binding = true;
  try {
    do {
      again = false;
      ++turn;
      const of = chosen, started = performance.now();
      $('bound').textContent = 'binding …';
      const answer = await post(`/api/jobs/${of}/rebind`, {joints: editor.joints, method: $('binding').value});
      const bytes = await answer.arrayBuffer();
      if (of !== chosen || !editor.active) return;
      const all = Math.round(performance.now() - started);
      job().edited = true;
      shownFile = `${of}/edited`;
      await stage.show(bytes, {keepView: true});
      editor.rebound();
      showClips($('clip').value);
      $('bound').textContent = `bound in ${answer.headers.get('x-bind-milliseconds')} ms, ${all} ms with motions and transfer`;
      document.body.dataset.shown = shownFile;
    } while (again);
  } catch (problem) {
    $('bound').textContent = '';
    throw problem;
  } finally {
    binding = false;
  }
});

function addEditor() {
  const edit = (id, action) => $(id).addEventListener('click', guarded(async () => {
    if (action() === false) return;
    showEditor();
    if ($('follow').checked) await rebind();
  }));
  edit('undo', () => editor.undo());
  edit('redo', () => editor.redo());
  edit('add_joint', () => editor.add());
  edit('delete_joint', () => editor.delete());
  edit('mirror_joint', () => editor.mirror());
  edit('centre_joint', () => editor.centre());
  $('joint_name').addEventListener('change', guarded(async () => {
    if (editor.rename($('joint_name').value.trim()) && $('follow').checked) await rebind();
  }));
  $('rebind').addEventListener('click', rebind);
  document.addEventListener('keydown', (event) => {
    if (tab !== 'edit' || !editor?.active || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== 'z') return;
    event.preventDefault();
    $(event.shiftKey ? 'redo' : 'undo').click();
  });
}

// --- Comparing ---

function closeComparison() {
  for (const {stage: other} of compared) other.dispose();
  compared = [];
  $('compare_stages').replaceChildren();
  $('compare_stages').hidden = true;
  $('stage').hidden = false;
  $('comparing').textContent = '';
}

const compare = guarded(async () => {
  const methods = [...document.querySelectorAll('#methods input:checked')].map((box) => box.value);
  const of = chosen, base = job();
  const made = (await (await post(`/api/jobs/${of}/compare`, {methods})).json()).jobs.map(({id}) => id);
  $('comparing').textContent = 'rigging …';
  let all;
  do {
    await look();
    if (chosen !== of || tab !== 'compare') return;
    all = made.map((id) => jobs.find((j) => j.id === id)).filter(Boolean);
    await new Promise((resolve) => setTimeout(resolve, 150));
  } while (all.some(isActive));
  const failed = all.filter((j) => j.state !== 'done');
  const done = [base, ...all.filter((j) => j.state === 'done')];
  closeComparison();
  $('stage').hidden = true;
  $('compare_stages').hidden = false;
  const {Stage} = await import('/viewer.js'), began = performance.now();
  const places = done.map((one) => {
    const place = element('div', {className: 'canvas'});
    const caption = one === base ? one.name : `${one.options.method}: ${one.result.joints} joints, ${one.result.seconds.toFixed(1)} s`;
    $('compare_stages').append(element('figure', {}, place, element('figcaption', {textContent: caption})));
    return place;
  });
  for (const [i, one] of done.entries()) {
    const other = new Stage(places[i]);
    compared.push({stage: other});
    await other.show(await (await ask(`/api/jobs/${one.id}/files/${one.edited ? 'edited' : 'rigged'}.glb`)).arrayBuffer());
    other.showBones($('show_bones').checked);
    other.play($('clip').value);
    other.clock = () => $('play').textContent === 'Pause' ? (performance.now() - began) / 1000 : other.time;
  }
  $('comparing').textContent = failed.map((j) => `${j.options.method}: ${j.error}`).join('; ');
  document.body.dataset.compared = String(compared.length);
});

// --- Checking ---

const showFindings = guarded(async () => {
  const {findings} = await (await post(`/api/jobs/${chosen}/lint`)).json();
  const lines = findings.map((finding) => element('li', {className: finding.severity, textContent: `${finding.severity}: ${finding.sentence}`}));
  $('findings').replaceChildren(...(lines.length > 0 ? lines : [element('li', {textContent: 'Nothing is wrong with this rig.'})]));
  $('scores').replaceChildren();
});

const evaluate = guarded(async () => {
  const form = new FormData(), file = $('truth').files[0];
  if (!file) return;
  form.append('job', chosen);
  form.append('truth', file, file.name);
  const scores = await (await ask('/api/evaluate', {method: 'POST', body: form})).json();
  $('truth').value = '';
  $('scores').replaceChildren(...Object.entries(scores.values).map(
      ([key, value]) => element('tr', {}, element('td', {textContent: key}), element('td', {textContent: Number(value).toPrecision(4)}))));
});

// --- Start ---

function addControls() {
  for (const button of document.querySelectorAll('#tabs button')) button.addEventListener('click', guarded(() => openTab(button.dataset.tab)));
  $('clip').addEventListener('change', () => {
    stage.play($('clip').value);
    for (const {stage: other} of compared) other.play($('clip').value);
  });
  $('play').addEventListener('click', () => {
    const playing = $('play').textContent === 'Play';
    $('play').textContent = playing ? 'Pause' : 'Play';
    stage.playing = playing;
  });
  $('show_bones').addEventListener('change', () => {
    for (const one of [stage, ...compared.map((c) => c.stage)]) one.showBones($('show_bones').checked);
  });
  $('compare').addEventListener('click', compare);
  $('truth').addEventListener('change', evaluate);
  $('methods').append(...studio.methods.filter((word) => word !== 'auto').map((word) => element(
      'label', {}, element('input', {type: 'checkbox', value: word, checked: ['curve', 'pinocchio', 'heat'].includes(word)}), ' ' + word)));
  for (const [id, words] of [['method', studio.methods], ['species', studio.templates]])
    $(id).append(...words.map((word) => element('option', {value: word, textContent: word})));
}

try {
  studio = await (await ask('/api/studio')).json();
  $('version').textContent = studio.version;
  addDoors();
  addGallery();
  addControls();
  addEditor();
  await look();
} catch (problem) {
  fail(problem);
}
document.body.dataset.ready = 'yes';
