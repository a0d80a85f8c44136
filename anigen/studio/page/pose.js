// A pose by dragging joints: the chain above the dragged joint turns until the joint is where the pointer is (cyclic
// coordinate descent). Bones keep their lengths.
import * as THREE from 'three';

import {JointDrag} from '/joint_drag.js';
import {Undoable} from '/undo.js';

const kRounds = 12;

// Turns the bones of a chain, nearest to the end first, so that `end` comes to `target` (in the scene).
export function reach(end, chain, target) {
  const tip = new THREE.Vector3(), place = new THREE.Vector3(), turn = new THREE.Quaternion(), above = new THREE.Quaternion();
  for (let round = 0; round < kRounds; round++) {
    for (const bone of chain) {
      bone.getWorldPosition(place);
      end.getWorldPosition(tip);
      const from = tip.sub(place), to = target.clone().sub(place);
      if (from.lengthSq() < 1e-12 || to.lengthSq() < 1e-12) continue;
      turn.setFromUnitVectors(from.normalize(), to.normalize());
      // The turn in the scene as one in the frame of the bone's parent.
      bone.parent.getWorldQuaternion(above);
      bone.quaternion.premultiply(above.clone().invert().multiply(turn).multiply(above)).normalize();
      bone.updateMatrixWorld(true);
    }
    if (end.getWorldPosition(tip).distanceTo(target) < 1e-4) return;
  }
}

export class Poser extends Undoable {
  // changed(): pose, choice or what can be undone differ; chain(): how many bones turn at most.
  constructor(stage, {changed, chain}) {
    super();
    Object.assign(this, {stage, changed, chain});
    this.active = false;
    this.drag = new JointDrag(stage, {
      active: () => this.active,
      places: () => stage.places(),
      nearOnly: () => false,
      taken: (j) => { stage.marked = j; },
      begun: () => this.remember(),
      moved: (j, place) => this.pull(j, place),
      dropped: () => this.changed(),
    });
  }

  open() {
    this.active = true;
    this.stage.play(undefined);
    this.stage.marked = -1;
    this.stage.lines.group.visible = true;
    this.forgetSteps();
    this.changed();
  }

  close() {
    if (!this.active) return;
    this.active = false;
    this.stage.marked = undefined;
    this.stage.rested();
    this.stage.showBones(this.stage.bonesShown);
  }

  // The root moves; any other joint is reached by turning the bones above it.
  pull(j, place) {
    const {bones, parents} = this.stage, chain = [];
    for (let at = parents[j]; at >= 0 && chain.length < this.chain(); at = parents[at]) chain.push(bones[at]);
    if (chain.length > 0) return reach(bones[j], chain, place);
    bones[j].position.copy(bones[j].parent.worldToLocal(place.clone()));
    bones[j].updateMatrixWorld(true);
  }

  snapshot() { return this.stage.bones.map(({position, quaternion}) => [position.clone(), quaternion.clone()]); }
  restore(pose) {
    this.stage.bones.forEach((bone, j) => {
      bone.position.copy(pose[j][0]);
      bone.quaternion.copy(pose[j][1]);
    });
    this.changed();
  }
  reset() {
    this.remember();
    this.stage.rested();
    this.changed();
  }
}
