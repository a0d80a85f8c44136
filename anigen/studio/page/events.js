// Keeps the list of jobs as the studio has it: server-sent events of the jobs at work, and a look at all of them now and
// then. Where no stream comes, it looks more often.
import {askJson, calm, fail, isActive, jobOf, state, tell} from '/base.js';

const kWithout = 500, kWaiting = 1500, kIdle = 4000;  // milliseconds between two looks: no stream, jobs wait, nothing to do
const kMostStreams = 2;                               // a browser opens six connections to one address

const streams = new Map();  // id → EventSource; null: none comes for this job
let timer, looking, again = false, lost = false;

function accept(job) {
  const at = state.jobs.findIndex((one) => one.id === job.id);
  if (at >= 0) state.jobs[at] = job;
  else state.jobs.push(job);
  tell('jobs');
}

function stop(id, value) {
  streams.get(id)?.close();
  if (value === undefined) streams.delete(id);
  else streams.set(id, value);
}

function follow(id) {
  const source = new EventSource(`/v1/jobs/${id}/events`);
  streams.set(id, source);
  source.addEventListener('job', (event) => {
    const job = JSON.parse(event.data);
    document.body.dataset.events = Number(document.body.dataset.events ?? 0) + 1;
    if (!isActive(job)) stop(id);
    accept(job);
    if (!isActive(job)) look();
  });
  // The stream ends with its job, or the studio went away: the list says which.
  source.addEventListener('error', () => {
    if (streams.get(id) !== source) return;
    stop(id, null);
    look();
  });
}

function followActive() {
  for (const id of [...streams.keys()]) if (!jobOf(id) || !isActive(jobOf(id))) stop(id);
  const open = () => [...streams.values()].filter(Boolean).length;
  const wanted = state.jobs.filter((job) => job.state === 'running' || (job.id === state.chosen && isActive(job)));
  for (const job of wanted) if (!streams.has(job.id) && open() < kMostStreams) follow(job.id);
}

function nextLook() {
  const active = state.jobs.filter(isActive);
  if (active.length === 0) return kIdle;
  return active.some((job) => job.state === 'running' && !streams.get(job.id)) ? kWithout : kWaiting;
}

// Asks for the jobs, and tells all parts of the page. A call while one is under way makes it look once more.
export function look() {
  if (looking) {
    again = true;
    return looking;
  }
  clearTimeout(timer);
  looking = (async () => {
    do {
      again = false;
      try {
        const {jobs} = await askJson('/v1/jobs');
        if (lost) calm();
        lost = false;
        if (again) continue;  // on its way since before a change, such as a new job that is chosen
        state.jobs = jobs;
        if (!jobOf(state.chosen)) state.chosen = undefined;
        followActive();
        tell('jobs');
      } catch (problem) {
        lost = true;
        fail(problem);
      }
    } while (again);
    looking = undefined;
    timer = setTimeout(look, nextLook());
  })();
  return looking;
}

// The job once it has ended. stopped(): whether nobody waits any more.
export function ended(id, stopped = () => false) {
  return new Promise((resolve) => {
    const check = setInterval(() => {
      const job = jobOf(id);
      if (!stopped() && job && isActive(job)) return;
      clearInterval(check);
      resolve(stopped() ? undefined : job);
    }, 60);
  });
}

// Jobs that are left open when the page goes would keep connections of the studio.
window.addEventListener('pagehide', () => { for (const id of [...streams.keys()]) stop(id); });
