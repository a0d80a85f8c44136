// Files, the program, and fingers for the test of the studio's page.
import {spawn} from 'node:child_process';

import {pause} from '../../scripts/devtools.mjs';

export function expect(condition, what) {
  if (!condition) throw new Error(what);
}

// A worm with a bend, closed.
export function wormObj() {
  const rings = 28, sides = 14, lines = [];
  for (let r = 0; r < rings; r++) {
    const t = r / (rings - 1), x = t - 0.5, z = 0.15 * Math.sin(3 * t), radius = 0.07 + 0.03 * Math.sin(9 * t);
    for (let s = 0; s < sides; s++) {
      const a = 2 * Math.PI * s / sides;
      lines.push(`v ${x} ${z + radius * Math.cos(a)} ${radius * Math.sin(a)}`);
    }
  }
  for (let r = 0; r + 1 < rings; r++)
    for (let s = 0; s < sides; s++) {
      const a = r * sides + s + 1, b = r * sides + (s + 1) % sides + 1;
      lines.push(`f ${a} ${b} ${b + sides} ${a + sides}`);
    }
  const cap = (from, order) => lines.push('f ' + order.map((s) => from + s + 1).join(' '));
  const around = [...Array(sides).keys()];
  cap(0, [...around].reverse());
  cap((rings - 1) * sides, around);
  return lines.join('\n') + '\n';
}

// A chain of six bones in a wave.
export function waveBvh() {
  const joints = 6, frames = 20;
  let text = 'HIERARCHY\n', pad = '';
  for (let j = 0; j < joints; j++, pad += '  ') {
    const channels = j ? '3' : '6 Xposition Yposition Zposition';
    text += `${pad}${j ? 'JOINT' : 'ROOT'} b${j}\n${pad}{\n${pad}  OFFSET ${j ? '10 0 0' : '0 0 0'}\n${pad}  CHANNELS ${channels} Zrotation Xrotation Yrotation\n`;
  }
  text += `${pad}End Site\n${pad}{\n${pad}  OFFSET 10 0 0\n${pad}}\n`;
  for (let j = joints; j-- > 0;) text += `${pad = pad.slice(2)}}\n`;
  text += `MOTION\nFrames: ${frames}\nFrame Time: 0.05\n`;
  for (let f = 0; f < frames; f++) {
    const turns = Array.from({length: joints}, (_, j) => [15 * Math.sin(2 * Math.PI * f / frames + j), 0, 0]);
    text += [0, 0, 0, ...turns.flat()].join(' ') + '\n';
  }
  return text;
}

// The program, until it prints its address.
export function startStudio(program, output) {
  const child = spawn(program, ['--output', output], {stdio: ['ignore', 'pipe', 'pipe']});
  return new Promise((resolve, reject) => {
    let said = '', warned = '';
    child.stderr.on('data', (part) => warned += part);
    child.stdout.on('data', (part) => {
      said += part;
      if (said.includes('\n')) resolve({child, address: said.trim(), warned: () => warned});
    });
    child.on('exit', (code) => reject(new Error(`anigen-studio ended with ${code}: ${warned}`)));
  });
}

// Ends it by Ctrl-C. Returns what was wrong with its end, '' if nothing.
export async function stopStudio(studio) {
  studio.child.removeAllListeners('exit');
  const ended = new Promise((resolve) => studio.child.on('exit', resolve));
  studio.child.kill('SIGINT');
  const code = await Promise.race([ended, pause(20_000).then(() => 'no end within 20 s of Ctrl-C')]);
  studio.child.kill('SIGKILL');
  return code === 0 ? '' : 'anigen-studio: ' + code;
}

export const jobsOf = async (address) => (await (await fetch(address + 'v1/jobs')).json()).jobs;

export const text = (id) => `document.getElementById(${JSON.stringify(id)}).textContent`;

// Actions of a person on the page.
export class User {
  constructor(page, address) { Object.assign(this, {page, address}); }

  value(expression) { return this.page.value(expression); }
  until(expression, what) { return this.page.until(expression, what); }
  click(selector) { return this.value(`document.querySelector(${JSON.stringify(selector)}).click()`); }
  // Sets a control, as its user does.
  set(id, value) {
    return this.value(`(() => { const e = document.getElementById(${JSON.stringify(id)});
      e.type === 'checkbox' ? e.checked = ${JSON.stringify(value)} : e.value = ${JSON.stringify(value)};
      e.dispatchEvent(new Event('input', {bubbles: true})); e.dispatchEvent(new Event('change', {bubbles: true})); })()`);
  }
  async open(tab) {
    await this.click(`[data-tab=${tab}]`);
    await this.until(`document.body.dataset.tab === '${tab}'`, 'tab ' + tab);
  }

  async giveFile(selector, file) {
    const {root} = await this.page.send('DOM.getDocument');
    const {nodeId} = await this.page.send('DOM.querySelector', {nodeId: root.nodeId, selector});
    await this.page.send('DOM.setFileInputFiles', {files: [file], nodeId});
  }

  // Waits for the newest job of which is(job) to end well. Returns it.
  async job(is, what) {
    for (const end = Date.now() + 120_000; Date.now() < end; await pause(100)) {
      const job = (await jobsOf(this.address)).filter(is).at(-1);
      if (job?.state === 'failed') throw new Error(`${what}: ${job.error}`);
      if (job?.state === 'done') return job;
    }
    throw new Error(what + ' did not end');
  }
  async shown(job) {
    await this.until(`document.body.dataset.shown?.startsWith('${job.id}/')`, 'showing ' + job.name);
    return job;
  }
  show(job) { return this.click(`#jobs li[data-id=${job.id}]`); }

  async mouse(type, [x, y], buttons = 0) {
    await this.page.send('Input.dispatchMouseEvent', {type, x, y, buttons, button: type === 'mouseMoved' && buttons === 0 ? 'none' : 'left', clickCount: 1});
  }
  // Presses at the first place and moves over the others; pauses let drafts come. @param held called before the release
  async drag(places, milliseconds = 0, held = undefined) {
    await this.mouse('mousePressed', places[0], 1);
    for (const place of places.slice(1)) {
      await this.mouse('mouseMoved', place, 1);
      if (milliseconds > 0) await pause(milliseconds);
    }
    await held?.();
    await this.mouse('mouseReleased', places.at(-1));
  }
  // Left and top of an element in the window, once it is scrolled to.
  corner(selector) {
    return this.value(`(() => { const e = document.querySelector(${JSON.stringify(selector)}); e.scrollIntoView({block: 'nearest'});
      const {left, top, width, height} = e.getBoundingClientRect(); return [left, top, width, height]; })()`);
  }
  failure() { return this.value(`document.getElementById('failure').hidden ? '' : ${text('failure')}`); }
  picture(file) { return this.page.picture(file); }
}
