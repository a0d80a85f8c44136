// Joints that are dragged on the canvas: a press on one chooses it, and a movement takes it along in the plane of the
// screen. The press never reaches what else listens on the canvas, such as the camera.
import * as THREE from 'three';

const kReach = 22;  // CSS pixels from a joint within which a press takes it
const kNear = 10;   // where arrows stand around the chosen joint
const kStart = 4;   // CSS pixels of movement that begin a drag

export class JointDrag {
  // active(): whether presses count; places(): of the joints; nearOnly(j): whether only a press right on joint j takes it;
  // taken(j): pressed; begun(j): moves; moved(j, place, event): in the plane of the screen; dropped(j).
  constructor(stage, actions) {
    Object.assign(this, {stage, ...actions});
    stage.element.addEventListener('pointerdown', (event) => this.press(event), {capture: true});
  }

  // The joint under a press, -1: none.
  under(event) {
    const box = this.stage.renderer.domElement.getBoundingClientRect();
    const far = this.stage.onScreen(this.places()).map(([x, y]) => Math.hypot(x + box.left - event.clientX, y + box.top - event.clientY));
    const nearest = far.indexOf(Math.min(...far));
    if (nearest < 0 || far[nearest] > (this.nearOnly(nearest) ? kNear : kReach)) return -1;
    return nearest;
  }

  press(event) {
    if (!this.active() || event.button !== 0 || !event.isPrimary) return;
    const joint = this.under(event);
    if (joint < 0) return;
    event.stopPropagation();
    this.taken(joint);
    const start = this.places()[joint], normal = this.stage.camera.getWorldDirection(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, start);
    let moves = false;
    const move = (next) => {
      if (next.pointerId !== event.pointerId) return;
      if (!moves && Math.hypot(next.clientX - event.clientX, next.clientY - event.clientY) < kStart) return;
      if (!moves) this.begun(joint);
      moves = true;
      const place = this.stage.rayAt(next).intersectPlane(plane, new THREE.Vector3());
      if (place) this.moved(joint, place, next);
    };
    const up = (next) => {
      if (next.pointerId !== event.pointerId) return;
      for (const [name, action] of [['pointermove', move], ['pointerup', up], ['pointercancel', up]]) window.removeEventListener(name, action);
      if (moves) this.dropped(joint);
    };
    for (const [name, action] of [['pointermove', move], ['pointerup', up], ['pointercancel', up]]) window.addEventListener(name, action);
  }
}
