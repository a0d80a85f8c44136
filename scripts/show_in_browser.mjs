// Opens a rigged GLB with three.js in headless Chromium, poses it, and saves a picture: as it is, and posed.
//
//   node scripts/show_in_browser.mjs FILE.glb OUT.png
//
// An animation of the file is played to a third of its length; a file without one has every joint turned a little.
// Fails when the page reports an error, when there is no skinned mesh, or when posing moves no vertex. Exit code 77:
// Chromium or the npm package "three" is not installed. The package is looked for in the folders of NODE_PATH and in
// node_modules beside the current folder.
import {writeFileSync, mkdtempSync, rmSync} from 'node:fs';
import os from 'node:os';
import path from 'node:path';

import {chromium, openHeadless, servePage, threeFolder} from './chromium.mjs';

const kSeconds = 120;

const kPage = `<!doctype html><body style="margin:0"><canvas id="c" width="1280" height="640"></canvas>
<script type="importmap">{"imports": {"three": "/three/build/three.module.js"}}</script>
<script type="module">
const report = (body) => fetch('/report', {method: 'POST', body: JSON.stringify(body)});
window.addEventListener('error', (e) => report({error: e.message}));
window.addEventListener('unhandledrejection', (e) => report({error: String(e.reason)}));
try {
  const THREE = await import('three');
  const {GLTFLoader} = await import('/three/examples/jsm/loaders/GLTFLoader.js');
  const gltf = await new GLTFLoader().loadAsync('/asset.glb');
  const meshes = [];
  gltf.scene.traverse((o) => { if (o.isSkinnedMesh) meshes.push(o); });
  if (meshes.length === 0) throw new Error('no skinned mesh');
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf4f4f4);
  scene.add(gltf.scene, new THREE.HemisphereLight(0xffffff, 0x8090a0, 2.5));
  const sun = new THREE.DirectionalLight(0xffffff, 2);
  sun.position.set(1, 2, 3);
  scene.add(sun);
  const places = () => {
    gltf.scene.updateMatrixWorld(true);
    return meshes.map((mesh) => {
      mesh.skeleton.update();
      const count = mesh.geometry.attributes.position.count, result = [];
      for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 2000))) {
        const p = new THREE.Vector3().fromBufferAttribute(mesh.geometry.attributes.position, i);
        result.push(mesh.applyBoneTransform(i, p).clone());
      }
      return result;
    }).flat();
  };
  const before = places();
  const box = new THREE.Box3().setFromPoints(before), size = box.getSize(new THREE.Vector3()).length();
  const center = box.getCenter(new THREE.Vector3());
  const renderer = new THREE.WebGLRenderer({canvas: document.getElementById('c'), antialias: true, preserveDrawingBuffer: true});
  renderer.autoClear = false;
  renderer.clear();
  const camera = new THREE.PerspectiveCamera(35, 1, size / 100, size * 10);
  camera.position.copy(center).add(new THREE.Vector3(0.7, 0.5, 1).normalize().multiplyScalar(size * 1.7));
  camera.lookAt(center);
  const draw = (x) => {
    renderer.setViewport(x, 0, 640, 640);
    renderer.setScissor(x, 0, 640, 640);
    renderer.setScissorTest(true);
    renderer.render(scene, camera);
  };
  draw(0);
  let how;
  if (gltf.animations.length > 0) {
    const clip = gltf.animations[0], mixer = new THREE.AnimationMixer(gltf.scene);
    mixer.clipAction(clip).play();
    mixer.setTime(clip.duration / 3);
    how = 'animation "' + clip.name + '" at ' + (clip.duration / 3).toFixed(2) + ' s';
  } else {
    const bones = new Set(meshes.flatMap((mesh) => mesh.skeleton.bones));
    for (const bone of bones) if (bones.has(bone.parent)) bone.rotateZ(0.25).rotateX(0.15);
    how = 'every joint turned';
  }
  const after = places();
  draw(640);
  const moved = after.filter((p, i) => p.distanceTo(before[i]) > 1e-3 * size).length;
  if (after.some((p) => !isFinite(p.lengthSq()))) throw new Error('a posed vertex is not finite');
  if (moved === 0) throw new Error('posing moves no vertex');
  const joints = meshes.map((mesh) => mesh.skeleton.bones.length);
  await report({picture: renderer.domElement.toDataURL('image/png'), moved, of: after.length, joints, how});
} catch (error) { await report({error: String(error)}); }
</script>`;

const [asset, out] = process.argv.slice(2);
if (out === undefined) {
  console.error('usage: node scripts/show_in_browser.mjs FILE.glb OUT.png');
  process.exit(2);
}
const three = threeFolder(), browser = chromium();
if (three === undefined || browser === undefined) {
  console.error((three === undefined ? 'three is not installed: npm install three, or set NODE_PATH' : 'Chromium is not installed'));
  process.exit(77);
}
const profile = mkdtempSync(path.join(os.tmpdir(), 'anigen-browser-'));
let child;
const finish = (code) => {
  child?.kill('SIGKILL');
  setTimeout(() => { rmSync(profile, {recursive: true, force: true, maxRetries: 5}); process.exit(code); }, 300);
};
const server = servePage(kPage, three, (url) => url === '/asset.glb' ? asset : undefined, (result) => {
  if (result.error !== undefined) {
    console.error(asset + ': ' + result.error);
    return finish(1);
  }
  writeFileSync(out, Buffer.from(result.picture.split(',')[1], 'base64'));
  console.log(`${asset}: ${result.joints.join(' + ')} joints; ${result.how}: ${result.moved} of ${result.of} vertices move; ${out}`);
  finish(0);
});
server.listen(0, '127.0.0.1', () => {
  const url = `http://127.0.0.1:${server.address().port}/`;
  child = openHeadless(browser, profile, url);
  child.on('error', (error) => { console.error(String(error)); finish(1); });
});
setTimeout(() => { console.error(`${asset}: the page gave no answer in ${kSeconds} s`); finish(1); }, kSeconds * 1000);
