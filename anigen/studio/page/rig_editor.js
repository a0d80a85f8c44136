// Joints that can be moved, added, deleted, mirrored and renamed, with undo; the server binds the weights again.
import * as THREE from 'three';
import {TransformControls} from 'three/addons/controls/TransformControls.js';

import {SkeletonLines} from '/viewer.js';

const kReach = 22;      // CSS pixels from a joint within which a tap chooses it
const kMostUndo = 200;

// The name of the joint on the other side: "arm_L" and "arm_R", "LeftArm" and "RightArm"; else with a word behind.
export function otherSide(name) {
  const pairs = [[/_L$/, '_R'], [/_R$/, '_L'], [/\.L$/, '.R'], [/\.R$/, '.L'], [/Left/, 'Right'], [/Right/, 'Left'],
                 [/left/, 'right'], [/right/, 'left']];
  for (const [from, to] of pairs) if (from.test(name)) return name.replace(from, to);
  return name + '_mirrored';
}

export class RigEditor {
  // changed(): joints or choice differ; moving(): a joint is being dragged; dropped(): it was let go.
  constructor(stage, {changed, moving, dropped}) {
    this.stage = stage;
    this.changed = changed;
    this.dropped = dropped;
    this.active = false;
    this.handle = new THREE.Object3D();
    this.gizmo = new TransformControls(stage.camera, stage.renderer.domElement);
    this.gizmo.setSize(0.8);
    this.gizmo.addEventListener('dragging-changed', ({value}) => {
      stage.controls.enabled = !value;
      if (value) return this.remember();
      this.dropped();
    });
    this.gizmo.addEventListener('objectChange', () => {
      if (this.chosen < 0) return;
      this.joints[this.chosen].position = this.handle.position.toArray();
      this.draw();
      moving();
    });
    this.helper = this.gizmo.getHelper ? this.gizmo.getHelper() : this.gizmo;
    stage.renderer.domElement.addEventListener('pointerdown', (event) => this.pick(event));
  }

  open() {
    this.active = true;
    this.stage.play(undefined);
    this.stage.model.updateMatrixWorld(true);
    this.load(this.stage.joints());
    this.undone = [];
    this.past = [];
    this.stage.scene.add(this.handle, this.helper);
    this.stage.setSolid(false);
    this.stage.lines.group.visible = false;
    this.choose(-1);
  }

  close() {
    if (!this.active) return;
    this.active = false;
    this.gizmo.detach();
    this.stage.scene.remove(this.handle, this.helper);
    if (this.lines) this.stage.scene.remove(this.lines.group);
    this.lines?.dispose();
    this.lines = undefined;
    this.stage.paint(undefined);
    this.stage.setSolid(true);
    this.stage.showBones(this.stage.bonesShown);
  }

  // The stage shows another rig of the same joints: its own lines stay hidden.
  rebound() {
    this.stage.setSolid(false);
    this.stage.lines.group.visible = false;
    this.paint();
  }

  // The weights of the chosen joint.
  paint() { this.stage.paint(this.joints[this.chosen]?.name); }

  load(joints) {
    this.joints = joints;
    if (this.lines) this.stage.scene.remove(this.lines.group), this.lines.dispose();
    this.lines = new SkeletonLines(joints.map((joint) => joint.parent));
    this.stage.scene.add(this.lines.group);
    this.chosen = Math.min(this.chosen ?? -1, joints.length - 1);
    this.draw();
  }

  places() { return this.joints.map((joint) => new THREE.Vector3(...joint.position)); }
  draw() { this.lines.put(this.places(), this.chosen); }

  choose(joint) {
    this.chosen = joint;
    if (joint < 0) {
      this.gizmo.detach();
    } else {
      this.handle.position.set(...this.joints[joint].position);
      this.gizmo.attach(this.handle);
    }
    this.draw();
    this.paint();
    this.changed();
  }

  // CSS pixels of every joint on the canvas.
  onScreen() {
    const {clientWidth, clientHeight} = this.stage.renderer.domElement;
    this.stage.camera.updateMatrixWorld();
    return this.places().map((place) => {
      const p = place.project(this.stage.camera);
      return [(p.x + 1) / 2 * clientWidth, (1 - p.y) / 2 * clientHeight];
    });
  }

  pick(event) {
    if (!this.active || this.gizmo.dragging || this.gizmo.axis) return;
    const box = this.stage.renderer.domElement.getBoundingClientRect();
    const at = [event.clientX - box.left, event.clientY - box.top];
    const far = this.onScreen().map(([x, y]) => Math.hypot(x - at[0], y - at[1]));
    const nearest = far.indexOf(Math.min(...far));
    if (far[nearest] <= kReach && nearest !== this.chosen) this.choose(nearest);
  }

  snapshot() { return JSON.stringify({joints: this.joints, chosen: this.chosen}); }
  restore(text) {
    const {joints, chosen} = JSON.parse(text);
    this.load(joints);
    this.choose(chosen);
  }
  remember() {
    this.past.push(this.snapshot());
    if (this.past.length > kMostUndo) this.past.shift();
    this.undone = [];
  }
  undo() {
    if (this.past.length === 0) return false;
    this.undone.push(this.snapshot());
    this.restore(this.past.pop());
    return true;
  }
  redo() {
    if (this.undone.length === 0) return false;
    this.past.push(this.snapshot());
    this.restore(this.undone.pop());
    return true;
  }

  freeName(wanted) {
    const names = new Set(this.joints.map((joint) => joint.name));
    if (!names.has(wanted)) return wanted;
    for (let n = 2;; ++n) if (!names.has(`${wanted}_${n}`)) return `${wanted}_${n}`;
  }

  // Moves the chosen joint along the line of sight to the middle between front and back of the mesh, where it is seen.
  centre() {
    if (this.chosen < 0) return false;
    const place = new THREE.Vector3(...this.joints[this.chosen].position), {ray, distances} = this.stage.crossings(place);
    let best;
    for (let i = 0; i + 1 < distances.length; i += 2) {
      const middle = ray.at((distances[i] + distances[i + 1]) / 2, new THREE.Vector3());
      if (best === undefined || middle.distanceTo(place) < best.distanceTo(place)) best = middle;
    }
    if (best === undefined) return false;
    this.remember();
    this.joints[this.chosen].position = best.toArray();
    this.choose(this.chosen);
    return true;
  }

  // A child of the chosen joint, in the direction of its bone.
  add() {
    if (this.chosen < 0) return false;
    this.remember();
    const joint = this.joints[this.chosen], place = new THREE.Vector3(...joint.position);
    const from = joint.parent < 0 ? place.clone().sub(new THREE.Vector3(0, 0.1 * this.stage.size, 0))
                                  : new THREE.Vector3(...this.joints[joint.parent].position);
    const step = place.clone().sub(from).setLength(Math.max(0.03 * this.stage.size, 0.5 * place.distanceTo(from)));
    const joints = [...this.joints, {name: this.freeName(joint.name + '_child'), parent: this.chosen,
                                     position: place.add(step).toArray()}];
    this.load(joints);
    this.choose(joints.length - 1);
    return true;
  }

  // Children go to the joint above; the root goes only where one child can take its place.
  delete() {
    const gone = this.chosen;
    if (gone < 0 || this.joints.length === 1) return false;
    const above = this.joints[gone].parent, children = this.joints.filter((joint) => joint.parent === gone);
    if (above < 0 && children.length !== 1) return false;
    this.remember();
    const moved = (parent) => parent > gone ? parent - 1 : parent;
    const joints = this.joints.filter((_, j) => j !== gone)
                       .map((joint) => ({...joint, parent: joint.parent === gone ? moved(above) : moved(joint.parent)}));
    this.load(joints);
    this.choose(above < 0 ? joints.findIndex((joint) => joint.parent < 0) : moved(above));
    return true;
  }

  // The chosen joint and all below it on the other side of the plane of constant x through the root. Joints of the
  // other side's names move there; those that are missing are added.
  mirror() {
    if (this.chosen < 0) return false;
    this.remember();
    const joints = this.joints.map((joint) => ({...joint}));
    const middle = joints.find((joint) => joint.parent < 0).position[0];
    const below = (j) => j === this.chosen || (joints[j].parent >= 0 && below(joints[j].parent));
    const twins = new Map();
    for (const j of joints.keys()) {
      if (j >= this.joints.length || !below(j)) continue;
      const {name, position} = joints[j], there = [2 * middle - position[0], position[1], position[2]];
      if (Math.abs(position[0] - middle) < 0.01 * this.stage.size) {
        twins.set(j, j);  // in the middle: its own twin
        continue;
      }
      const known = joints.findIndex((joint) => joint.name === otherSide(name));
      twins.set(j, known);
      if (known >= 0) {
        joints[known].position = there;
        continue;
      }
      twins.set(j, joints.length);
      joints.push({name: otherSide(name), parent: -2, position: there, of: j});
    }
    for (const joint of joints) {
      if (joint.of === undefined) continue;
      const above = joints[joint.of].parent;
      joint.parent = above < 0 ? joint.of : twins.get(above) ?? this.twinOf(joints, above);
      delete joint.of;
    }
    const chosen = twins.get(this.chosen);
    this.load(joints);
    this.choose(chosen);
    return true;
  }
  twinOf(joints, j) {
    const twin = joints.findIndex((joint) => joint.name === otherSide(joints[j].name));
    return twin >= 0 ? twin : j;
  }

  rename(name) {
    if (this.chosen < 0 || name === '' || name === this.joints[this.chosen].name) return false;
    this.remember();
    this.joints[this.chosen].name = this.freeName(name);
    this.changed();
    return true;
  }
}
