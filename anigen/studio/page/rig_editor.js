// Joints and weights that can be changed, with undo for everything; the studio binds the weights again. What is edited is a
// list of joints and a list of brush strokes, and every step back restores both.
import * as THREE from 'three';
import {TransformControls} from 'three/addons/controls/TransformControls.js';

import {JointDrag} from '/joint_drag.js';
import * as edits from '/joint_edits.js';
import {Undoable} from '/undo.js';
import {SkeletonLines} from '/viewer.js';

export class RigEditor extends Undoable {
  // changed(): joints or choice differ; moving(): a joint is being dragged; dropped(): it was let go.
  constructor(stage, {changed, moving, dropped}) {
    super();
    Object.assign(this, {stage, changed, moving, dropped});
    this.active = false;
    this.painting = false;  // presses are the brush's
    this.held = false;      // nothing can be edited
    this.snaps = true;      // joints go to the middle of the mesh under the cursor
    this.handle = new THREE.Object3D();
    this.gizmo = new TransformControls(stage.camera, stage.renderer.domElement);
    this.gizmo.setSize(0.8);
    this.gizmo.addEventListener('dragging-changed', ({value}) => {
      stage.controls.enabled = !value;
      if (value) return this.remember();
      this.dropped();
    });
    this.gizmo.addEventListener('objectChange', () => {
      if (this.chosen >= 0) this.put(this.chosen, this.handle.position);
    });
    this.helper = this.gizmo.getHelper ? this.gizmo.getHelper() : this.gizmo;
    this.drag = new JointDrag(stage, {
      active: () => this.active && !this.held && !this.painting && !this.gizmo.dragging,
      places: () => this.places(),
      nearOnly: (j) => j === this.chosen || Boolean(this.gizmo.axis),
      taken: (j) => this.take(j),
      begun: () => this.remember(),
      moved: (j, place, event) => {
        const middle = this.snaps ? stage.middleOf(stage.rayAt(event)) : undefined;
        this.handle.position.copy(middle ?? place);
        this.put(j, this.handle.position);
      },
      dropped: () => this.dropped(),
    });
  }

  // before: snapshot of an earlier time with these joints, whose strokes go on
  open(before) {
    this.active = true;
    this.stage.play(undefined);
    this.stage.model.updateMatrixWorld(true);
    this.joints = this.stage.joints().map((joint) => ({...joint, was: joint.name}));  // was: name in the rig as it was made
    this.strokes = [];
    this.kept = true;  // no joint was moved or added: the rig's own weights stay
    this.continue(before);
    this.forgetSteps();
    this.merging = false;
    this.stage.scene.add(this.handle, this.helper);
    this.stage.setSolid(false);
    this.stage.lines.group.visible = false;
    this.redraw();
    this.choose(-1);
  }

  continue(before) {
    if (before === undefined) return;
    const {joints, strokes, kept} = JSON.parse(before), named = (list) => list.map((joint) => joint.name).join('\n');
    if (named(joints) !== named(this.joints)) return;
    Object.assign(this, {strokes, kept});
    this.joints.forEach((joint, j) => joint.was = joints[j].was);
  }

  close() {
    if (!this.active) return;
    this.active = false;
    this.setPainting(false);
    this.gizmo.detach();
    this.stage.scene.remove(this.handle, this.helper);
    if (this.lines) this.stage.scene.remove(this.lines.group);
    this.lines?.dispose();
    this.lines = undefined;
    this.stage.paint(undefined);
    this.stage.setSolid(true);
    this.stage.showBones(this.stage.bonesShown);
  }

  // The stage shows another rig of these joints: its own lines stay hidden.
  rebound() {
    this.stage.setSolid(false);
    this.stage.lines.group.visible = false;
    this.paint();
  }

  // The weights of the chosen joint.
  paint() { this.stage.paint(this.joints[this.chosen]?.name); }

  redraw() {
    if (this.lines) this.stage.scene.remove(this.lines.group), this.lines.dispose();
    this.lines = new SkeletonLines(this.joints.map((joint) => joint.parent));
    this.stage.scene.add(this.lines.group);
    this.chosen = Math.min(this.chosen ?? -1, this.joints.length - 1);
    this.draw();
  }

  places() { return this.joints.map((joint) => new THREE.Vector3(...joint.position)); }
  draw() { this.lines.put(this.places(), this.chosen); }
  onScreen() { return this.stage.onScreen(this.places()); }

  choose(joint) {
    this.chosen = joint;
    if (joint >= 0) this.handle.position.set(...this.joints[joint].position);
    if (joint >= 0 && !this.painting) this.gizmo.attach(this.handle);
    else this.gizmo.detach();
    this.draw();
    this.paint();
    this.changed();
  }

  // A press on a joint: chooses it, or merges it with the one that is chosen.
  take(joint) {
    if (!this.merging || joint === this.chosen) return void (joint !== this.chosen && this.choose(joint));
    this.merging = false;
    if (this.merge(joint)) this.dropped();
  }

  put(joint, place) {
    this.joints[joint].position = place.toArray();
    this.kept = false;
    this.draw();
    this.moving();
  }

  setPainting(painting) {
    this.painting = painting;
    if (!painting) this.unpainted?.();
    if (this.active) this.choose(this.chosen);
  }

  hold(held) {
    this.held = held;
    this.gizmo.enabled = !held;
  }

  // --- Undo ---

  snapshot() {
    const {joints, strokes, kept, chosen} = this;
    return JSON.stringify({joints, strokes, kept, chosen});
  }
  restore(text) {
    const {chosen, ...rest} = JSON.parse(text);
    Object.assign(this, rest);
    this.redraw();
    this.choose(chosen);
  }

  // --- Edits: false where they cannot be done ---

  apply(edit) {
    if (edit === undefined) return false;
    this.remember();
    this.joints = edit.joints;
    this.kept &&= edit.keeps === true;
    if (edit.renamed) this.renameStrokes(edit.renamed);
    const names = new Set(this.joints.map((joint) => joint.name));
    this.strokes = this.strokes.filter((stroke) => names.has(stroke.joint));
    this.redraw();
    this.choose(edit.chosen);
    return true;
  }
  renameStrokes(names) {
    this.strokes = this.strokes.map((stroke) => ({...stroke, joint: names.get(stroke.joint) ?? stroke.joint}));
  }

  add() { return this.apply(edits.addedChild(this.joints, this.chosen, this.stage.size)); }
  delete() { return this.apply(edits.deleted(this.joints, this.chosen)); }
  mirror() { return this.apply(edits.mirrored(this.joints, this.chosen, this.stage.size)); }
  merge(other) { return this.apply(edits.merged(this.joints, this.chosen, other)); }

  // Moves the chosen joint along the line of sight to the middle between front and back of the mesh, where it is seen.
  centre() {
    if (this.chosen < 0) return false;
    const place = this.handle.position.clone(), eye = this.stage.camera.position;
    const ray = new THREE.Ray(eye.clone(), place.clone().sub(eye).normalize()), distances = this.stage.crossings(ray);
    let best;
    for (let i = 0; i + 1 < distances.length; i += 2) {
      const middle = ray.at((distances[i] + distances[i + 1]) / 2, new THREE.Vector3());
      if (best === undefined || middle.distanceTo(place) < best.distanceTo(place)) best = middle;
    }
    return best !== undefined && this.moveTo(best);
  }

  // Moves the chosen joint in the plane of the screen. right, up: shares of the mesh's size
  nudge(right, up) {
    if (this.chosen < 0) return false;
    const step = new THREE.Vector3(right, up, 0).multiplyScalar(this.stage.size).applyQuaternion(this.stage.camera.quaternion);
    return this.moveTo(this.handle.position.clone().add(step));
  }

  moveTo(place) {
    this.remember();
    this.joints[this.chosen].position = place.toArray();
    this.kept = false;
    this.choose(this.chosen);
    return true;
  }

  rename(name) {
    if (this.chosen < 0 || name === '' || name === this.joints[this.chosen].name) return false;
    const names = this.joints.map((joint) => joint.name);
    names[this.chosen] = edits.freeName(this.joints, name);
    this.renameAll(names);
    return true;
  }

  // Another name for every joint.
  renameAll(names) {
    this.remember();
    this.renameStrokes(new Map(this.joints.map((joint, j) => [joint.name, names[j]])));
    this.joints = this.joints.map((joint, j) => ({...joint, name: names[j]}));
    this.changed();
  }

  addStrokes(strokes) { this.strokes = [...this.strokes, ...strokes]; }
}
