// Loads VRM files as three.js applications do (npm packages "three" and "@pixiv/three-vrm"), without a browser.
//
//   node scripts/validate_vrm.mjs FILE...
//
// A file is good when the loader takes it for VRM 1.0, finds the 15 required bones at nodes of the scene, the bones of
// the left on the left of a model that faces +Z, and survives a second of its springs without a number that is not
// finite. Textures are not decoded.
//
// Exit code: 0 all files are good, 1 some file is not, 2 wrong usage, 77 the packages are not installed. They are looked
// for in the folders of NODE_PATH and in node_modules beside the current folder.
import {existsSync} from 'node:fs';
import {readFile} from 'node:fs/promises';
import path from 'node:path';
import {pathToFileURL} from 'node:url';

const kRequired = ['hips', 'spine', 'head', ...['left', 'right'].flatMap(
    (side) => ['UpperArm', 'LowerArm', 'Hand', 'UpperLeg', 'LowerLeg', 'Foot'].map((bone) => side + bone))];

// The packages import "three" by its name, which node resolves beside them: all of one folder, or none.
function folderOfModules() {
  const folders = [...(process.env.NODE_PATH ?? '').split(path.delimiter), path.join(process.cwd(), 'node_modules')];
  return folders.filter((folder) => folder !== '').find(
      (folder) => existsSync(path.join(folder, 'three')) && existsSync(path.join(folder, '@pixiv/three-vrm')));
}

// Stand-ins for the parts of a browser that the loader uses.
function provideBrowser() {
  globalThis.self ??= globalThis;
  globalThis.window ??= globalThis;
  globalThis.ProgressEvent ??= class extends Event {};
  URL.createObjectURL = () => 'data:image/png;base64,';
}

function rise(node) {
  node.updateWorldMatrix(true, false);
  return node.matrixWorld.elements;
}

async function check(modules, file) {
  const {THREE, GLTFLoader, VRMLoaderPlugin} = modules;
  const bytes = await readFile(file);
  const loader = new GLTFLoader();
  loader.register((parser) => {
    parser.loadTexture = async () => new THREE.Texture();
    parser.loadImageSource = async () => new THREE.Texture();
    return new VRMLoaderPlugin(parser);
  });
  const copy = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  const gltf = await loader.parseAsync(copy, '');
  const vrm = gltf.userData.vrm;
  if (!vrm) throw new Error('the loader finds no VRM in it');
  if (vrm.meta.metaVersion !== '1') throw new Error(`it is VRM ${vrm.meta.metaVersion}, not 1.0`);
  const missing = kRequired.filter((bone) => !vrm.humanoid.getRawBoneNode(bone));
  if (missing.length > 0) throw new Error(`no ${missing.join(', ')}`);
  for (const bone of kRequired.filter((name) => name.startsWith('left'))) {
    const other = bone.replace('left', 'right');
    const [left, right] = [bone, other].map((name) => rise(vrm.humanoid.getRawBoneNode(name))[12]);
    if (left < right) throw new Error(`${bone} is on the right of a model that faces +Z`);
  }
  for (let i = 0; i < 60; ++i) vrm.update(1 / 60);
  gltf.scene.traverse((node) => {
    if (rise(node).some((x) => !Number.isFinite(x))) throw new Error(`node ${node.name} leaves all bounds in motion`);
  });
  const bones = Object.keys(vrm.humanoid.humanBones).length;
  const springs = vrm.springBoneManager ? vrm.springBoneManager.joints.size : 0;
  console.log(`${file}: ${bones} bones, ${springs} joints of springs, by ${vrm.meta.authors.join(', ')}`);
}

const files = process.argv.slice(2);
if (files.length === 0) {
  console.error('usage: node scripts/validate_vrm.mjs FILE...');
  process.exit(2);
}
const folder = folderOfModules();
if (!folder) {
  console.error('three and @pixiv/three-vrm are not installed: npm install three @pixiv/three-vrm, or set NODE_PATH');
  process.exit(77);
}
provideBrowser();
const load = (name) => import(pathToFileURL(path.join(folder, name)).href);
const THREE = await load('three/build/three.module.js');
const {GLTFLoader} = await load('three/examples/jsm/loaders/GLTFLoader.js');
const {VRMLoaderPlugin} = await load('@pixiv/three-vrm/lib/three-vrm.module.js');
let failed = 0;
for (const file of files) {
  try {
    await check({THREE, GLTFLoader, VRMLoaderPlugin}, file);
  } catch (error) {
    console.log(`${file}: ${error.message ?? error}`);
    failed += 1;
  }
}
console.log(`${files.length} files, ${failed} not good`);
process.exit(failed > 0 ? 1 : 0);
