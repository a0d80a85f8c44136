// A brush on the mesh that adds, removes or smooths the weights of the chosen joint. It collects strokes; the studio applies
// them after it has bound the weights.
import * as THREE from 'three';

const kMostStrokes = 5000;  // of one rig

export class WeightBrush {
  // settings(): {radius: share of the mesh's size, strength, mode}; painting(): strokes were added; painted(): let go;
  // refuse(sentence): why nothing is painted.
  constructor(stage, editor, {settings, painting, painted, refuse}) {
    Object.assign(this, {stage, editor, settings, painting, painted, refuse});
    this.ball = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16),
                               new THREE.MeshBasicMaterial({color: 0x0b62c4, transparent: true, opacity: 0.25, depthTest: false}));
    this.ball.renderOrder = 12;
    editor.unpainted = () => this.hide();
    stage.element.addEventListener('pointerdown', (event) => this.press(event), {capture: true});
    stage.element.addEventListener('pointermove', (event) => this.hover(event));
    stage.element.addEventListener('pointerleave', () => this.hide());
  }

  get active() { return this.editor.active && this.editor.painting; }
  hide() { this.stage.scene.remove(this.ball); }

  // The point at which a ray of sight meets the mesh; undefined: none.
  hit(event) {
    const ray = this.stage.rayAt(event), [distance] = this.stage.crossings(ray);
    return distance === undefined ? undefined : ray.at(distance, new THREE.Vector3());
  }

  hover(event) {
    if (!this.active) return this.hide();
    const place = this.hit(event);
    if (place === undefined) return this.hide();
    this.ball.position.copy(place);
    this.ball.scale.setScalar(this.settings().radius * this.stage.size);
    this.stage.scene.add(this.ball);
  }

  press(event) {
    if (!this.active || event.button !== 0 || !event.isPrimary) return;
    const first = this.hit(event);
    if (first === undefined) return;  // beside the mesh: the camera turns
    event.stopPropagation();
    if (this.editor.held) return;
    const {editor} = this, joint = editor.joints[editor.chosen]?.name;
    if (joint === undefined) return this.refuse('Choose a joint first: the brush paints its weights.');
    if (editor.strokes.length >= kMostStrokes) return this.refuse(`This rig has ${kMostStrokes} strokes already.`);
    editor.remember();
    let last;
    const stroke = (place) => {
      const {radius: share, strength, mode} = this.settings(), radius = share * this.stage.size;
      if (last !== undefined && last.distanceTo(place) < radius / 3) return;
      last = place;
      editor.addStrokes([{joint, center: place.toArray(), radius, strength, mode}]);
      this.painting();
    };
    stroke(first);
    const move = (next) => {
      if (next.pointerId !== event.pointerId) return;
      const place = this.hit(next);
      if (place !== undefined && editor.strokes.length < kMostStrokes) stroke(place);
    };
    const up = (next) => {
      if (next.pointerId !== event.pointerId) return;
      for (const [name, action] of [['pointermove', move], ['pointerup', up], ['pointercancel', up]]) window.removeEventListener(name, action);
      this.painted();
    };
    for (const [name, action] of [['pointermove', move], ['pointerup', up], ['pointercancel', up]]) window.addEventListener(name, action);
  }
}
