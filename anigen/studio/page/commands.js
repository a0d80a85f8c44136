// Settings of a job in words, and the command line that repeats it.
const quoted = (word) => /^[\w.+-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`;

// "seed 42, 12 structure steps" or "method heat, symmetric"; for history and captions.
export function settingsOf({kind, options, names}) {
  const words = [];
  if (kind === 'generation') words.push(`seed ${options.seed ?? 42}`);
  if (names?.mask) words.push('own mask');
  const texts = {method: 'method', skin: 'weights', joints: 'joints', influences: 'influences', names: 'names by', ss_steps: 'structure steps',
                 slat_steps: 'latent steps', voxels_of: 'voxels of', stop_at: 'stops at', fps: 'fps', protocol: 'protocol'};
  for (const [key, name] of Object.entries(texts)) if (options[key]) words.push(`${name} ${options[key]}`);
  if (options.templates?.length) words.push(options.templates.join(' or '));
  if (options.motions?.length) words.push(`motions ${options.motions.join(' ')}`);
  if (options.symmetric) words.push('symmetric');
  if (options.keep_skeleton === false) words.push('new skeleton');
  return words.join(', ');
}

function generation(job, stem) {
  const {options} = job, words = [];
  for (const key of ['ss_steps', 'slat_steps', 'joints']) if (options[key]) words.push(`--${key.replace('_', '-')} ${options[key]}`);
  if (job.names?.mask) words.push(`--mask ${quoted(job.names.mask)}`);
  if (options.stop_at) words.push(`--stop-at ${options.stop_at}`);
  return ['anigen-generate', quoted(job.name), `--seed ${options.seed ?? 42}`, ...words, '-o', quoted(stem)];
}

function rig(job, stem) {
  const {options} = job, words = [];
  for (const key of ['method', 'skin', 'joints', 'influences', 'names']) if (options[key]) words.push(`--${key} ${options[key]}`);
  if (options.bone_axes) words.push(`--bone-axes ${options.bone_axes}`);
  for (const word of options.templates ?? []) words.push(`--template ${word}`);
  if (options.symmetric) words.push('--symmetric');
  if (options.keep_skeleton === false && (options.method ?? 'auto') === 'auto') words.push('--new-skeleton');
  return ['anigen-rig', quoted(job.name), ...words, '-o', quoted(`${stem}_rigged.glb`)];
}

function animation({name, names, options}, stem) {
  const motions = [...options.motions ?? [], ...(names?.motion ? [names.motion] : [])];
  const words = motions.map((motion) => `--motion ${quoted(motion)}`);
  if (options.travel) words.push('--travel');
  return ['anigen-animate', quoted(name), ...words, `--fps ${options.fps ?? 24}`, '-o', quoted(`${stem}_animated.glb`)];
}

function evaluation({name, names, options}, stem) {
  const groups = options.groups ?? ['skeleton', 'transport', 'skin', 'surface'];
  const words = options.protocol ? [`--protocol ${options.protocol}`] : [`--metrics ${groups.join()}`];
  if (options.registration === false) words.push('--no-icp');
  return ['anigen-eval', '--pred', quoted(name), '-d', quoted(names.truth), ...words, '-o', quoted(`${stem}_scores`)];
}

// The command line that makes the result of a job again; motions, masks and edits aside.
export function commandOf(job) {
  const stem = job.name.replace(/\.[^.]*$/, '');
  const makers = {generation, rig, animation, evaluation};
  return makers[job.kind]?.(job, stem).join(' ') ?? '';
}
