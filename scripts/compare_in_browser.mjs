// Shows pairs of GLB files with three.js in headless Chromium and compares the pictures.
//
//   node scripts/compare_in_browser.mjs [--pictures FOLDER] BEFORE.glb AFTER.glb [BEFORE.glb AFTER.glb ...]
//
// Both files of a pair are seen by one camera, which fits the first; as they rest if both rest in their bind pose, else
// posed by their inverse bind matrices ("posed"), of which a joint of several skins has only one. A line of JSON per pair: "mean", mean difference of a channel in 1/255; "differing", share of pixels of which a channel
// differs by more than 8; "surface", share of pixels that show something in the first. --pictures writes both beside
// each other as NUMBER.png. Exit code 1 where a file cannot be shown or "differing" is more than 1 %; 77: Chromium or
// the npm package "three" is not installed (see chromium.mjs).
import {mkdirSync, mkdtempSync, rmSync, writeFileSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';

import {chromium, openHeadless, servePage, threeFolder} from './chromium.mjs';

const kSecondsOfPair = 120, kMostDiffering = 0.01;

const kPage = `<!doctype html><body style="margin:0"><canvas id="c" width="1024" height="512"></canvas>
<script type="importmap">{"imports": {"three": "/three/build/three.module.js"}}</script>
<script type="module">
const report = (body) => fetch('/report', {method: 'POST', body: JSON.stringify(body)});
window.addEventListener('error', (e) => report({error: e.message}));
window.addEventListener('unhandledrejection', (e) => report({error: String(e.reason)}));
const THREE = await import('three');
const {GLTFLoader} = await import('/three/examples/jsm/loaders/GLTFLoader.js');
const {DRACOLoader} = await import('/three/examples/jsm/loaders/DRACOLoader.js');
const {MeshoptDecoder} = await import('/three/examples/jsm/libs/meshopt_decoder.module.js');
const loader = new GLTFLoader();
loader.setDRACOLoader(new DRACOLoader().setDecoderPath('/three/examples/jsm/libs/draco/gltf/'));
loader.setMeshoptDecoder(MeshoptDecoder);
const kSize = 512;
const renderer = new THREE.WebGLRenderer({canvas: document.getElementById('c'), antialias: true, preserveDrawingBuffer: true});
renderer.setScissorTest(true);
const placeOf = (mesh, i) => {
  const p = new THREE.Vector3().fromBufferAttribute(mesh.geometry.attributes.position, i);
  if (mesh.isSkinnedMesh) mesh.applyBoneTransform(i, p);
  return p.applyMatrix4(mesh.matrixWorld);
};
// True where all joints of every skin move what hangs on them alike: the file rests in its bind pose.
const restsBound = (meshes) => meshes.filter((mesh) => mesh.isSkinnedMesh).every(({skeleton}) => {
  const moves = skeleton.bones.map((bone, j) => bone.matrixWorld.clone().multiply(skeleton.boneInverses[j]).elements);
  const size = Math.max(...moves[0].map(Math.abs));
  return moves.every((move) => move.every((x, k) => Math.abs(x - moves[0][k]) < 1e-3 * size));
});
async function load(url) {
  const {scene} = await loader.loadAsync(url);
  const meshes = [];
  scene.traverse((o) => { if (o.isMesh) meshes.push(o); });
  scene.updateMatrixWorld(true);
  return {scene, meshes, rests: restsBound(meshes)};
}
// Puts every joint where its inverse bind matrix says; Skeleton.pose() would leave out nodes above that are no joints.
function bind({scene, meshes}) {
  const worlds = new Map();
  for (const mesh of meshes.filter((mesh) => mesh.isSkinnedMesh))
    mesh.skeleton.bones.forEach((bone, j) => worlds.set(bone, mesh.skeleton.boneInverses[j].clone().invert()));
  const place = (node, above) => {
    const world = worlds.get(node) ?? above.clone().multiply(node.matrix);
    node.matrix.copy(above).invert().multiply(world);
    node.matrixAutoUpdate = false;
    for (const child of node.children) place(child, world);
  };
  scene.traverse((node) => node.updateMatrix());
  place(scene, new THREE.Matrix4());
}
function boxOf({scene, meshes}) {
  const box = new THREE.Box3();
  scene.updateMatrixWorld(true);
  for (const mesh of meshes) {
    mesh.frustumCulled = false;
    if (mesh.isSkinnedMesh) mesh.skeleton.update();
    const count = mesh.geometry.attributes.position.count;
    for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 2000))) box.expandByPoint(placeOf(mesh, i));
  }
  return box;
}
function draw(shown, camera, x) {
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf4f4f4);
  const sun = new THREE.DirectionalLight(0xffffff, 2);
  sun.position.set(1, 2, 3);
  scene.add(shown, new THREE.HemisphereLight(0xffffff, 0x8090a0, 2.5), sun);
  renderer.setViewport(x, 0, kSize, kSize);
  renderer.setScissor(x, 0, kSize, kSize);
  renderer.render(scene, camera);
  const gl = renderer.getContext(), pixels = new Uint8Array(4 * kSize * kSize);
  gl.readPixels(x, 0, kSize, kSize, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  return pixels;
}
for (let i = 0; i < COUNT; ++i) {
  try {
    const before = await load('/' + i + '/before.glb'), after = await load('/' + i + '/after.glb');
    const posed = !before.rests || !after.rests;
    for (const file of posed ? [before, after] : []) bind(file);
    boxOf(after);
    const box = boxOf(before), size = box.getSize(new THREE.Vector3()).length(), center = box.getCenter(new THREE.Vector3());
    if (box.isEmpty()) throw new Error('no vertices');
    const camera = new THREE.PerspectiveCamera(35, 1, size / 100, size * 10);
    camera.position.copy(center).add(new THREE.Vector3(0.7, 0.5, 1).normalize().multiplyScalar(size * 1.7));
    camera.lookAt(center);
    const first = draw(before.scene, camera, 0), second = draw(after.scene, camera, kSize);
    let sum = 0, differing = 0, surface = 0;
    for (let p = 0; p < first.length; p += 4) {
      let most = 0, ground = 0;
      for (let k = 0; k < 3; ++k) {
        const difference = Math.abs(first[p + k] - second[p + k]);
        sum += difference;
        most = Math.max(most, difference);
        ground = Math.max(ground, Math.abs(first[p + k] - first[k]));
      }
      if (most > 8) ++differing;
      if (ground > 2) ++surface;
    }
    const pixels = kSize * kSize;
    await report({pair: i, posed, mean: sum / (3 * pixels), differing: differing / pixels, surface: surface / pixels,
                  picture: renderer.domElement.toDataURL('image/png')});
  } catch (error) { await report({pair: i, error: String(error)}); }
}
await report({done: true});
</script>`;

let pictures, files = process.argv.slice(2);
if (files[0] === '--pictures') [pictures, files] = [files[1], files.slice(2)];
if (files.length === 0 || files.length % 2 !== 0) {
  console.error('usage: node scripts/compare_in_browser.mjs [--pictures FOLDER] BEFORE.glb AFTER.glb ...');
  process.exit(2);
}
const three = threeFolder(), browser = chromium();
if (three === undefined || browser === undefined) {
  console.error((three === undefined ? 'three is not installed: npm install three, or set NODE_PATH' : 'Chromium is not installed'));
  process.exit(77);
}
if (pictures !== undefined) mkdirSync(pictures, {recursive: true});

const profile = mkdtempSync(path.join(os.tmpdir(), 'anigen-browser-'));
let child, timer, code = 0;
const finish = () => {
  child?.kill('SIGKILL');
  setTimeout(() => { rmSync(profile, {recursive: true, force: true, maxRetries: 5}); process.exit(code); }, 300);
};
const wait = () => {
  clearTimeout(timer);
  timer = setTimeout(() => {
    console.error(`the page gave no answer in ${kSecondsOfPair} s`);
    code = 1;
    finish();
  }, kSecondsOfPair * 1000);
};
const take = (result) => {
  wait();
  if (result.done) return finish();
  const {picture, pair, ...figures} = result;
  if (pair === undefined) {  // an error of the page itself
    console.error(result.error);
    code = 1;
    return finish();
  }
  if (figures.error !== undefined || figures.differing > kMostDiffering) code = 1;
  console.log(JSON.stringify({before: files[2 * pair], after: files[2 * pair + 1], ...figures}));
  if (pictures !== undefined && picture !== undefined)
    writeFileSync(path.join(pictures, pair + '.png'), Buffer.from(picture.split(',')[1], 'base64'));
};
const server = servePage(kPage.replace('COUNT', files.length / 2), three, (url) => {
  const asset = url.match(/^\/(\d+)\/(before|after)\.glb$/);
  return asset === null ? undefined : files[2 * Number(asset[1]) + (asset[2] === 'after' ? 1 : 0)];
}, take);
server.listen(0, '127.0.0.1', () => {
  child = openHeadless(browser, profile, `http://127.0.0.1:${server.address().port}/`);
  child.on('error', (error) => { console.error(String(error)); code = 1; finish(); });
  wait();
});
