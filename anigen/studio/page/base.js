// Shared by all parts of the page: its state, requests to the studio, elements, and failures that are shown.
export const $ = (id) => document.getElementById(id);

// studio: answer of /v1/studio; jobs: those the studio has; chosen: id of the one that is shown; shown: file on the stage.
export const state = {studio: {}, jobs: [], chosen: undefined, shown: undefined, tab: 'view', stage: undefined, editor: undefined};

export const jobOf = (id) => state.jobs.find((job) => job.id === id);
export const chosenJob = () => jobOf(state.chosen);
export const isActive = (job) => job.state === 'queued' || job.state === 'running';
export const hasRig = (job) => job?.state === 'done' && job.result?.joints > 0;
export const latestOf = (job) => job.edited ? 'edited' : 'rigged';
export const titleOf = ({name, names}) => names?.motion ? `${name} + ${names.motion}` : names?.truth ? `${name} against ${names.truth}` : name;
export const fileOf = (job, name) => `/v1/jobs/${job.id}/files/${name}`;

// --- Parts of the page hear of each other's changes ---

const heard = new Map();
export function listen(name, action) {
  heard.set(name, [...heard.get(name) ?? [], action]);
}
export function tell(name, ...words) {
  for (const action of heard.get(name) ?? []) action(...words);
}

// --- Failures ---

export function fail(problem) {
  $('failure').textContent = problem instanceof Error ? problem.message : String(problem);
  $('failure').hidden = false;
}
export function calm() { $('failure').hidden = true; }

// Wraps an action of the page so that its failure is shown.
export function guarded(action) {
  return async (...words) => {
    try {
      calm();
      return await action(...words);
    } catch (problem) {
      fail(problem);
    }
  };
}

// --- Requests ---

// Answer of the studio, whatever its status.
export async function request(path, options) {
  try {
    return await fetch(path, options);
  } catch {
    throw new Error('the studio does not answer; was it stopped?');
  }
}
// Its sentence, where it refuses.
export async function refusal(answer) {
  const {error} = await answer.json().catch(() => ({}));
  return error ?? `the studio answered with ${answer.status}`;
}
export async function ask(path, options) {
  const answer = await request(path, options);
  if (!answer.ok) throw new Error(await refusal(answer));
  return answer;
}
export const askJson = async (path, options) => (await ask(path, options)).json();
export const post = (path, json) => ask(path, {method: 'POST', headers: {'content-type': 'application/json'}, body: JSON.stringify(json ?? {})});

// Sends a form of files and words; undefined ones are left out.
export function postForm(path, parts) {
  const form = new FormData();
  for (const [name, value] of Object.entries(parts)) {
    if (value === undefined) continue;
    if (value instanceof File) form.append(name, value, value.name);
    else form.append(name, typeof value === 'string' ? value : JSON.stringify(value));
  }
  return askJson(path, {method: 'POST', body: form});
}

// --- Elements ---

export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}
export function button(text, action, properties = {}) {
  const made = element('button', {type: 'button', textContent: text, ...properties});
  made.addEventListener('click', action);
  return made;
}
export const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

// A duration for people: "8 s", "3 min".
export function spoken(seconds) {
  return seconds < 90 ? `${Math.max(1, Math.round(seconds))} s` : `${Math.round(seconds / 60)} min`;
}
