// Downloads in every format, and what Khronos' validator says about the GLB.
import {$, ask, button, chosenJob, element, fileOf, guarded, latestOf, refusal, request, state} from '/base.js';

const kFormats = [['glb', 'GLB', 'web, Blender, engines'], ['vrm', 'VRM', 'humanoids'], ['fbx', 'FBX', 'Maya, Unity, Unreal'],
                  ['usdz', 'USDZ', 'Apple, Omniverse'], ['zip', 'OBJ + rig', 'mesh, textures, rig as text']];
const kSeverity = ['error', 'warning', 'info', 'hint'];

let worker, turn = 0;

function validate(bytes, name) {
  worker ??= new Worker('/validator_worker.js');
  const mine = ++turn;
  return new Promise((resolve, reject) => {
    worker.onerror = (event) => {
      event.preventDefault();
      worker = undefined;
      reject(new Error(event.message || 'the validator does not start'));
    };
    worker.addEventListener('message', function answered({data}) {
      if (data.turn !== mine) return;
      worker.removeEventListener('message', answered);
      if (data.failure) reject(new Error(data.failure));
      else resolve(data);
    });
    worker.postMessage({turn: mine, bytes, name}, [bytes]);
  });
}

const count = (n, word) => `${n} ${word}${n === 1 ? '' : 's'}`;

async function showVerdict(job, name) {
  $('issues').replaceChildren();
  $('verdict').className = '';
  if (!state.studio.validator) {
    $('verdict').textContent = 'The validator is not there (npm install gltf-validator).';
    return;
  }
  $('verdict').textContent = `glTF-Validator reads ${name} …`;
  const bytes = await (await ask(fileOf(job, name))).arrayBuffer();
  const {issues, version} = await validate(bytes, name);
  if (chosenJob()?.id !== job.id) return;
  const {numErrors, numWarnings, numInfos, numHints} = issues;
  $('verdict').className = numErrors > 0 ? 'error' : 'good';
  $('verdict').textContent = `glTF-Validator ${version}, ${name}: ${count(numErrors, 'error')}, ${count(numWarnings, 'warning')}, ` +
      count(numInfos + numHints, 'note');
  document.body.dataset.verdict = `${name} ${numErrors}`;
  $('issues').replaceChildren(...issues.messages.slice(0, 20).map(({severity, code, message, pointer}) => element(
      'li', {className: kSeverity[severity], textContent: `${kSeverity[severity]} ${code}${pointer ? ' at ' + pointer : ''}: ${message}`})));
}

// A download whose refusal is shown: not every rig can be every format.
const download = (job, name, said) => guarded(async () => {
  said.textContent = '…';
  const answer = await request(fileOf(job, name));
  if (!answer.ok) {
    said.textContent = await refusal(answer);
    return;
  }
  const bytes = await answer.blob(), named = answer.headers.get('content-disposition')?.match(/filename="([^"]+)"/)?.[1] ?? name;
  const url = URL.createObjectURL(bytes);
  element('a', {href: url, download: named}).click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
  said.textContent = `${named}, ${(bytes.size / 1024).toFixed(0)} KB`;
  if (name.endsWith('.glb') || name.endsWith('.vrm')) await showVerdict(job, name);
});

export const showExport = guarded(async () => {
  const job = chosenJob(), rows = [];
  for (const form of job.edited ? ['edited', 'rigged'] : ['rigged']) {
    if (job.edited) rows.push(element('h2', {textContent: form === 'edited' ? 'As edited' : 'As made'}));
    for (const [extension, title, use] of kFormats) {
      const name = `${form}.${extension}`, said = element('span', {className: 'hint', textContent: use});
      const get = button(title, download(job, name, said));
      get.dataset.file = name;
      rows.push(element('p', {className: 'download'}, get, ' ', said));
    }
  }
  $('downloads').replaceChildren(...rows);
  await showVerdict(job, latestOf(job) + '.glb');
});
