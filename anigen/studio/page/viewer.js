// A rigged GLB on the screen: orbit, clips, skeleton. Coordinates are those of the file, so that joints can be sent back.
import * as THREE from 'three';
import {OrbitControls} from 'three/addons/controls/OrbitControls.js';
import {GLTFLoader} from 'three/addons/loaders/GLTFLoader.js';

const kBothSides = new THREE.MeshBasicMaterial({side: THREE.DoubleSide});
const kOver = {depthTest: false, transparent: true};
const kCold = new THREE.Color(0xc6ccd4), kWarm = new THREE.Color(0xf2c230), kHot = new THREE.Color(0xc81e1e);

// The loader takes dots and spaces out of names, and keeps the file's own beside.
export const nameOf = (bone) => bone.userData.name ?? bone.name;

function points(count, size, color) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const made = new THREE.Points(geometry, new THREE.PointsMaterial({color, size, sizeAttenuation: false, ...kOver}));
  made.frustumCulled = false;
  made.renderOrder = 11;
  return made;
}

// Joints and bones drawn over everything else.
export class SkeletonLines {
  constructor(parents) {
    this.parents = parents;
    this.pairs = parents.flatMap((p, j) => p < 0 ? [] : [[p, j]]);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(6 * this.pairs.length), 3));
    this.lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({color: 0x0b4fb3, ...kOver}));
    this.lines.frustumCulled = false;
    this.lines.renderOrder = 10;
    this.dots = points(parents.length, 7, 0xe0481a);
    this.chosen = points(1, 14, 0x111111);
    this.chosen.visible = false;
    this.group = new THREE.Group().add(this.lines, this.chosen, this.dots);
  }
  put(places, chosen = -1) {
    const line = this.lines.geometry.attributes.position, dot = this.dots.geometry.attributes.position;
    this.pairs.forEach(([a, b], i) => {
      line.setXYZ(2 * i, ...places[a].toArray());
      line.setXYZ(2 * i + 1, ...places[b].toArray());
    });
    places.forEach((p, i) => dot.setXYZ(i, p.x, p.y, p.z));
    this.chosen.visible = chosen >= 0;
    if (chosen >= 0) this.chosen.geometry.attributes.position.setXYZ(0, ...places[chosen].toArray());
    for (const part of [this.lines, this.dots, this.chosen]) part.geometry.attributes.position.needsUpdate = true;
  }
  dispose() {
    for (const part of [this.lines, this.dots, this.chosen]) part.geometry.dispose(), part.material.dispose();
  }
}

export class Stage {
  constructor(element) {
    this.element = element;
    this.renderer = new THREE.WebGLRenderer({antialias: true, preserveDrawingBuffer: true});
    this.renderer.domElement.setAttribute('aria-label', '3D view: drag to turn, pinch or scroll to come closer');
    this.renderer.domElement.tabIndex = 0;
    element.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0xeef0f2);
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(1, 2, 3);
    this.scene.add(sun, new THREE.HemisphereLight(0xffffff, 0x8090a0, 1.9));
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.playing = true;
    this.bonesShown = true;
    this.time = 0;
    this.turn = 0;  // of show() and clear(): a file that is read late is not shown
    this.last = performance.now();
    this.sizes = new ResizeObserver(() => this.resize());
    this.sizes.observe(element);
    this.resize();
    this.renderer.setAnimationLoop((now) => this.frame(now));
  }

  resize() {
    const {clientWidth: width, clientHeight: height} = this.element;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
  }

  // Shows a GLB. The camera stays where it is for another rig of what was there. Gives false, and shows nothing, when
  // another one or none was to be shown while the file was read. still(): it is wanted then
  async show(buffer, {keepView = false, still = () => true} = {}) {
    const mine = ++this.turn, gltf = await new GLTFLoader().parseAsync(buffer, '');
    if (mine !== this.turn || !still()) return false;
    this.leave();
    this.model = gltf.scene;
    this.clips = gltf.animations;
    this.scene.add(this.model);
    this.meshes = [];
    this.model.traverse((o) => { if (o.isMesh) this.meshes.push(o); });
    for (const mesh of this.meshes) mesh.frustumCulled = false;
    this.bones = [...new Set(this.meshes.flatMap((mesh) => mesh.skeleton ? mesh.skeleton.bones : []))];
    const row = new Map(this.bones.map((bone, i) => [bone, i]));
    this.parents = this.bones.map((bone) => row.get(bone.parent) ?? -1);
    this.lines = new SkeletonLines(this.parents);
    this.lines.group.visible = this.bonesShown;
    this.scene.add(this.lines.group);
    this.mixer = new THREE.AnimationMixer(this.model);
    this.model.updateMatrixWorld(true);
    this.rest = this.places();
    this.restTurns = this.bones.map(({position, quaternion, scale}) => [position.clone(), quaternion.clone(), scale.clone()]);
    if (!keepView) this.fit();
    this.lines.put(this.rest);
    return true;
  }

  clear() {
    ++this.turn;
    this.leave();
  }

  // Takes what is shown from the stage.
  leave() {
    if (!this.model) return;
    this.mixer.stopAllAction();
    this.scene.remove(this.model, this.lines.group);
    this.lines.dispose();
    for (const mesh of this.meshes) {
      mesh.geometry.dispose();
      for (const material of [mesh.material, mesh.userData.own ?? [], mesh.userData.painted ?? []].flat())
        material.map?.dispose(), material.dispose();
    }
    this.model = undefined;
    this.action = undefined;
  }

  dispose() {
    this.clear();
    this.sizes.disconnect();
    this.renderer.setAnimationLoop(null);
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.renderer.domElement.remove();
  }

  fit() {
    const box = new THREE.Box3().setFromObject(this.model, true);
    this.centre = box.getCenter(new THREE.Vector3());
    this.size = Math.max(1e-6, box.getSize(new THREE.Vector3()).length());
    this.camera.position.copy(this.homeView(this.camera.aspect));
    this.camera.near = this.size / 200;
    this.camera.far = this.size * 40;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(this.centre);
    this.controls.update();
  }

  // Place of a camera of this aspect from which all is seen.
  homeView(aspect) {
    return new THREE.Vector3(0.8, 0.45, 1).setLength(1.5 * this.size / Math.min(1, aspect)).add(this.centre);
  }

  places() { return this.bones.map((bone) => bone.getWorldPosition(new THREE.Vector3())); }

  // Joints of the rest pose: [{name, parent, position}], as /rebind takes them.
  joints() {
    return this.bones.map((bone, j) => ({name: nameOf(bone), parent: this.parents[j],
                                         position: this.rest[j].toArray()}));
  }

  // Plays a clip from its beginning; undefined: the rest pose.
  play(name) {
    this.mixer.stopAllAction();
    this.rested();
    this.action = undefined;
    this.time = 0;
    const clip = this.clips.find((c) => c.name === name);
    if (clip) (this.action = this.mixer.clipAction(clip)).play();
    this.clip = clip;
  }

  // Bones as the file has them.
  rested() {
    this.bones.forEach((bone, j) => {
      const [position, quaternion, scale] = this.restTurns[j];
      bone.position.copy(position), bone.quaternion.copy(quaternion), bone.scale.copy(scale);
    });
  }

  setTime(time) {
    this.time = time;
    if (this.action && this.clip.duration > 0) this.mixer.setTime(time % this.clip.duration);
  }

  // CSS pixels on the canvas of places in the scene.
  onScreen(places) {
    const {clientWidth, clientHeight} = this.renderer.domElement;
    this.camera.updateMatrixWorld();
    return places.map((place) => {
      const p = place.clone().project(this.camera);
      return [(p.x + 1) / 2 * clientWidth, (1 - p.y) / 2 * clientHeight];
    });
  }

  showBones(shown) {
    this.bonesShown = shown;
    if (this.lines) this.lines.group.visible = shown;
  }

  setSolid(solid) {
    for (const material of (this.meshes ?? []).flatMap((mesh) => [mesh.userData.own ?? mesh.material].flat())) {
      material.transparent = !solid;
      material.opacity = solid ? 1 : 0.55;
      material.depthWrite = solid;
      material.needsUpdate = true;
    }
  }

  // Colours the mesh by the weights of a joint; undefined: its own materials.
  paint(name) {
    for (const mesh of this.meshes ?? []) {
      mesh.userData.own ??= mesh.material;
      mesh.userData.ownColor ??= mesh.geometry.getAttribute('color');
      const row = name === undefined || !mesh.skeleton ? -1 : mesh.skeleton.bones.findIndex((bone) => nameOf(bone) === name);
      if (row < 0) {
        mesh.material = mesh.userData.own;
        if (mesh.userData.ownColor) mesh.geometry.setAttribute('color', mesh.userData.ownColor);
        else mesh.geometry.deleteAttribute('color');
        continue;
      }
      const index = mesh.geometry.getAttribute('skinIndex'), weight = mesh.geometry.getAttribute('skinWeight');
      const colors = new Float32Array(3 * index.count), color = new THREE.Color();
      for (let i = 0; i < index.count; i++) {
        let sum = 0;
        for (let k = 0; k < 4; k++) if (index.getComponent(i, k) === row) sum += weight.getComponent(i, k);
        if (sum < 0.5) color.lerpColors(kCold, kWarm, 2 * sum);
        else color.lerpColors(kWarm, kHot, Math.min(1, 2 * sum - 1));
        color.toArray(colors, 3 * i);
      }
      mesh.geometry.setAttribute('color', new THREE.BufferAttribute(colors, 3));
      mesh.userData.painted ??= new THREE.MeshLambertMaterial({
        vertexColors: true, side: THREE.DoubleSide, transparent: true, opacity: 0.8,
        flatShading: mesh.geometry.getAttribute('normal') === undefined,
      });
      mesh.material = mesh.userData.painted;
    }
  }

  // The ray of sight through a place of the window, {clientX, clientY}.
  rayAt({clientX, clientY}) {
    const box = this.renderer.domElement.getBoundingClientRect();
    const at = new THREE.Vector2(2 * (clientX - box.left) / box.width - 1, 1 - 2 * (clientY - box.top) / box.height);
    const caster = new THREE.Raycaster();
    this.camera.updateMatrixWorld();
    caster.setFromCamera(at, this.camera);
    return caster.ray;
  }

  // Distances along a ray at which it crosses the surface of the rest pose, in order.
  crossings(ray) {
    const caster = new THREE.Raycaster(ray.origin, ray.direction), hits = [];
    for (const mesh of this.meshes) {
      // The geometry of a skinned mesh is its rest pose in the scene; testing that is much faster than skinning it.
      const solid = new THREE.Mesh(mesh.geometry, kBothSides);
      if (!mesh.skeleton) solid.matrixWorld.copy(mesh.matrixWorld);
      hits.push(...caster.intersectObject(solid, false));
    }
    const distances = hits.map((hit) => hit.distance).sort((a, b) => a - b);
    return distances.filter((d, i) => i === 0 || d - distances[i - 1] > 1e-6 * this.size);
  }

  // Middle between the first entry of a ray into the mesh and the exit that follows; undefined where it misses.
  middleOf(ray) {
    const distances = this.crossings(ray);
    return distances.length < 2 ? undefined : ray.at((distances[0] + distances[1]) / 2, new THREE.Vector3());
  }

  frame(now) {
    const passed = Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    if (!this.model || this.element.clientWidth === 0) return;
    if (this.playing && !this.clock) this.setTime(this.time + passed);
    if (this.clock) this.setTime(this.clock());
    this.controls.update();
    this.draw();
  }

  draw() {
    this.model.updateMatrixWorld(true);
    if (this.lines.group.visible) this.lines.put(this.places(), this.marked ?? -1);
    this.renderer.render(this.scene, this.camera);
  }
}
