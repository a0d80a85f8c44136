// Rigged assets side by side under one camera: turn, play, show the skeleton, paint the weights of a joint.
//
// Runs in report.html, where report_viewer.cpp puts three.js into an import map and every GLB, as base64, into a
// <script> of its own. Each <div class="viewer3d" data-assets="…"> lists assets: [{name, shown: [{label, glb}]}], glb
// being the id of that <script>.
import * as THREE from 'three';
import {GLTFLoader} from 'three/addons/GLTFLoader.js';
import {OrbitControls} from 'three/addons/OrbitControls.js';

const kHeight = 440, kNarrow = 600;  // CSS pixels; narrower pages put the models below each other
const kSwing = 0.3;                  // radians by which joints swing where a file has no animation
const kCold = new THREE.Color(0xc6ccd4), kWarm = new THREE.Color(0xf2c230), kHot = new THREE.Color(0xc81e1e);

function bytesOf(id) {
  const text = atob(document.getElementById(id).textContent), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes.buffer;
}

function heat(weight, color) {
  return weight < 0.5 ? color.lerpColors(kCold, kWarm, 2 * weight) : color.lerpColors(kWarm, kHot, 2 * weight - 1);
}

// One GLB, moved and scaled into the unit box.
class Model {
  constructor(gltf, label) {
    this.label = label;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0xeef0f2);
    this.holder = new THREE.Group();
    this.holder.add(gltf.scene);
    const sun = new THREE.DirectionalLight(0xffffff, 2);
    sun.position.set(1, 2, 3);
    this.scene.add(this.holder, new THREE.HemisphereLight(0xffffff, 0x8090a0, 2.2), sun);
    this.meshes = [];
    gltf.scene.traverse((o) => { if (o.isMesh) this.meshes.push(o); });
    for (const mesh of this.meshes) {
      mesh.frustumCulled = false;
      mesh.userData.own = mesh.material;
      mesh.userData.ownColor = mesh.geometry.getAttribute('color');
    }
    this.bones = [...new Set(this.meshes.flatMap((mesh) => mesh.skeleton ? mesh.skeleton.bones : []))];
    this.rest = this.bones.map((bone) => bone.quaternion.clone());
    this.fit();
    this.places = this.bonePlaces();
    this.addSkeleton();
    if (gltf.animations.length > 0) {
      this.mixer = new THREE.AnimationMixer(gltf.scene);
      this.length = gltf.animations[0].duration;
      this.mixer.clipAction(gltf.animations[0]).play();
    }
  }

  fit() {
    this.holder.updateMatrixWorld(true);
    const box = new THREE.Box3().setFromObject(this.holder, true);
    if (box.isEmpty()) throw new Error(this.label + ': holds no triangles');
    const size = box.getSize(new THREE.Vector3()), scale = 1 / Math.max(size.x, size.y, size.z, 1e-9);
    this.holder.scale.setScalar(scale);
    this.holder.position.copy(box.getCenter(new THREE.Vector3())).multiplyScalar(-scale);
    this.holder.updateMatrixWorld(true);
  }

  bonePlaces() { return this.bones.map((bone) => bone.getWorldPosition(new THREE.Vector3())); }

  addSkeleton() {
    const row = new Map(this.bones.map((bone, i) => [bone, i]));
    this.segments = this.bones.flatMap((bone, i) => row.has(bone.parent) ? [[row.get(bone.parent), i]] : []);
    const geometry = (count) => new THREE.BufferGeometry().setAttribute(
        'position', new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    const over = {depthTest: false, transparent: true};
    this.lines = new THREE.LineSegments(geometry(2 * this.segments.length), new THREE.LineBasicMaterial({color: 0x0b4fb3, ...over}));
    this.points = new THREE.Points(geometry(this.bones.length), new THREE.PointsMaterial({color: 0xe0481a, size: 6, sizeAttenuation: false, ...over}));
    this.marker = new THREE.Points(geometry(1), new THREE.PointsMaterial({color: 0x111111, size: 12, sizeAttenuation: false, ...over}));
    this.marker.visible = false;
    this.skeleton = new THREE.Group();
    this.skeleton.add(this.lines, this.points);
    for (const part of [this.lines, this.points, this.marker]) part.frustumCulled = false;
    this.skeleton.renderOrder = this.marker.renderOrder = 10;
    this.scene.add(this.skeleton, this.marker);
  }

  // Pose at a time in seconds; 0 is the rest pose of files without animation.
  pose(time) {
    if (this.mixer) {
      this.mixer.setTime(this.length > 0 ? time % this.length : 0);
    } else {
      const bones = new Set(this.bones), turn = new THREE.Quaternion(), angles = new THREE.Euler();
      this.bones.forEach((bone, i) => {
        bone.quaternion.copy(this.rest[i]);
        if (!bones.has(bone.parent)) return;
        const angle = kSwing * Math.sin(2 * time);
        bone.quaternion.multiply(turn.setFromEuler(angles.set(0.6 * angle, 0, angle)));
      });
    }
    this.holder.updateMatrixWorld(true);
    const places = this.bonePlaces();
    const put = (object, list) => {
      list.forEach((p, i) => object.geometry.attributes.position.setXYZ(i, p.x, p.y, p.z));
      object.geometry.attributes.position.needsUpdate = true;
    };
    put(this.lines, this.segments.flatMap(([a, b]) => [places[a], places[b]]));
    put(this.points, places);
    if (this.chosen !== undefined) put(this.marker, [places[this.chosen]]);
  }

  nearestJoint(place) {
    let best = undefined;
    this.places.forEach((p, i) => {
      if (best === undefined || p.distanceTo(place) < this.places[best].distanceTo(place)) best = i;
    });
    return best;
  }

  // Paints the weights of a joint; undefined: the asset's own colours.
  paint(joint) {
    this.chosen = joint;
    this.marker.visible = joint !== undefined;
    for (const mesh of this.meshes) {
      if (joint === undefined || !mesh.isSkinnedMesh) {
        mesh.material = mesh.userData.own;
        if (mesh.userData.ownColor) mesh.geometry.setAttribute('color', mesh.userData.ownColor);
        else mesh.geometry.deleteAttribute('color');
        continue;
      }
      const index = mesh.geometry.getAttribute('skinIndex'), weight = mesh.geometry.getAttribute('skinWeight');
      const row = mesh.skeleton.bones.indexOf(this.bones[joint]), color = new THREE.Color();
      const painted = new Float32Array(3 * index.count);
      for (let v = 0; v < index.count; v++) {
        let sum = 0;
        for (let k = 0; k < 4; k++) if (index.getComponent(v, k) === row) sum += weight.getComponent(v, k);
        heat(Math.min(1, sum), color).toArray(painted, 3 * v);
      }
      mesh.geometry.setAttribute('color', new THREE.BufferAttribute(painted, 3));
      mesh.userData.painted ??= new THREE.MeshLambertMaterial({vertexColors: true, side: THREE.DoubleSide});
      mesh.material = mesh.userData.painted;
    }
  }
}

class Viewer {
  constructor(element) {
    this.element = element;
    this.assets = JSON.parse(element.dataset.assets);
    this.models = [];
    this.time = 0;
    this.element.innerHTML = '<div class="bar"><select class="asset" aria-label="asset"></select> ' +
        '<button class="play" type="button">play</button> ' +
        '<label><input class="bones" type="checkbox" checked> skeleton</label> ' +
        '<label>weights of <select class="joint" aria-label="joint"></select></label></div>' +
        '<div class="labels"></div>';
    this.find = (name) => this.element.querySelector('.' + name);
    this.assets.forEach((asset, i) => this.find('asset').add(new Option(asset.name, i)));
    this.find('asset').onchange = () => this.open(this.assets[this.find('asset').value]);
    this.find('play').onclick = () => this.play(!this.playing);
    this.find('bones').onchange = () => this.draw();
    this.find('joint').onchange = () => this.choose(this.find('joint').value);
    this.renderer = new THREE.WebGLRenderer({antialias: true, preserveDrawingBuffer: true});
    this.renderer.setScissorTest(true);
    this.element.append(this.renderer.domElement);
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.05, 20);
    this.camera.position.set(1.1, 0.75, 1.5);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener('change', () => this.draw());
    new ResizeObserver(() => this.resize()).observe(this.element);
  }

  async open(asset) {
    const loader = new GLTFLoader();
    const models = [];
    for (const {label, glb} of asset.shown) models.push(new Model(await loader.parseAsync(bytesOf(glb), ''), label));
    this.models = models;
    const joints = this.find('joint');
    joints.replaceChildren(new Option('no joint', ''));
    models[0].bones.forEach((bone, i) => joints.add(new Option(bone.name || 'joint ' + i, i)));
    this.find('labels').replaceChildren(...models.map((model) => {
      const label = document.createElement('span');
      label.textContent = `${model.label}: ${model.bones.length} joints`;
      return label;
    }));
    this.time = 0;
    for (const model of models) model.pose(0);
    this.resize();
  }

  // A joint of the first model, and in the others the one that rests nearest to it.
  choose(value) {
    const first = this.models[0];
    this.models.forEach((model, i) => {
      model.paint(value === '' ? undefined : i === 0 ? Number(value) : model.nearestJoint(first.places[value]));
      model.pose(this.time);
    });
    this.draw();
  }

  play(on) {
    this.playing = on;
    this.find('play').textContent = on ? 'stop' : 'play';
    let last;
    const frame = (now) => {
      if (!this.playing) return;
      this.time += last === undefined ? 0 : Math.min(0.1, (now - last) / 1000);
      last = now;
      for (const model of this.models) model.pose(this.time);
      this.draw();
      requestAnimationFrame(frame);
    };
    if (on) requestAnimationFrame(frame);
  }

  resize() {
    const width = Math.max(100, Math.floor(this.element.clientWidth));
    this.stacked = width < kNarrow;
    this.find('labels').classList.toggle('stacked', this.stacked);
    const count = Math.max(1, this.models.length);
    this.width = this.stacked ? width : Math.floor(width / count);
    this.height = this.stacked ? Math.min(kHeight, Math.floor(0.9 * width)) : kHeight;
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(width, this.stacked ? this.height * count : this.height);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  draw() {
    const count = this.models.length;
    this.models.forEach((model, i) => {
      const x = this.stacked ? 0 : i * this.width, y = this.stacked ? (count - 1 - i) * this.height : 0;
      model.skeleton.visible = this.find('bones').checked;
      this.renderer.setViewport(x, y, this.width, this.height);
      this.renderer.setScissor(x, y, this.width, this.height);
      this.renderer.render(model.scene, this.camera);
    });
  }
}

function fail(element, error) {
  element.dataset.state = 'failed';
  element.textContent = 'No 3D view: ' + error;
  console.error(error);
}

// Decoding and drawing wait until the view is scrolled to.
for (const element of document.querySelectorAll('.viewer3d')) {
  new IntersectionObserver(async (entries, observer) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    observer.disconnect();
    try {
      const viewer = new Viewer(element);
      await viewer.open(viewer.assets[0]);
      element.dataset.state = 'open';
    } catch (error) { fail(element, error); }
  }).observe(element);
}
