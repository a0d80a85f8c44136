// Edits of a list of joints [{name, parent, position}] (parent −1: root). Each returns {joints, chosen} with new rows, or
// undefined where it cannot be done. `renamed` maps old names to new ones where joints became one; `keeps`: what weighed on
// a joint that is gone belongs to the one above it, so that the rig's own weights can stay.
const minus = (a, b) => a.map((v, i) => v - b[i]);
const lengthOf = (a) => Math.hypot(...a);

// The name of the joint on the other side: "arm_L" and "arm_R", "LeftArm" and "RightArm"; else with a word behind.
export function otherSide(name) {
  const pairs = [[/_L$/, '_R'], [/_R$/, '_L'], [/\.L$/, '.R'], [/\.R$/, '.L'], [/Left/, 'Right'], [/Right/, 'Left'],
                 [/left/, 'right'], [/right/, 'left']];
  for (const [from, to] of pairs) if (from.test(name)) return name.replace(from, to);
  return name + '_mirrored';
}

export function freeName(joints, wanted) {
  const names = new Set(joints.map((joint) => joint.name));
  if (!names.has(wanted)) return wanted;
  for (let n = 2;; ++n) if (!names.has(`${wanted}_${n}`)) return `${wanted}_${n}`;
}

// A child of a joint, in the direction of its bone. size: of the mesh
export function addedChild(joints, chosen, size) {
  if (chosen < 0) return undefined;
  const {name, parent, position} = joints[chosen];
  const along = parent < 0 ? [0, 0.1 * size, 0] : minus(position, joints[parent].position), far = lengthOf(along);
  const step = Math.max(0.03 * size, 0.5 * far);
  const place = position.map((v, i) => v + (far > 0 ? along[i] / far : i === 1 ? 1 : 0) * step);
  return {joints: [...joints, {name: freeName(joints, name + '_child'), parent: chosen, position: place}], chosen: joints.length};
}

// Without a joint: its children go to the joint above; the root goes only where one child can take its place.
export function deleted(joints, gone) {
  if (gone < 0 || joints.length === 1) return undefined;
  const above = joints[gone].parent, children = joints.filter((joint) => joint.parent === gone);
  if (above < 0 && children.length !== 1) return undefined;
  const moved = (parent) => parent > gone ? parent - 1 : parent;
  const left = joints.filter((_, j) => j !== gone)
                   .map((joint) => ({...joint, parent: joint.parent === gone ? (above < 0 ? -1 : moved(above)) : moved(joint.parent)}));
  return {joints: left, chosen: above < 0 ? left.findIndex((joint) => joint.parent < 0) : moved(above), keeps: true};
}

// Two joints as one, in the middle between them. The one nearer to the root keeps its name.
export function merged(joints, a, b) {
  if (a === b || a < 0 || b < 0) return undefined;
  const depth = (j) => joints[j].parent < 0 ? 0 : 1 + depth(joints[j].parent);
  const [stays, goes] = depth(a) <= depth(b) ? [a, b] : [b, a];
  const middle = joints[stays].position.map((v, i) => (v + joints[goes].position[i]) / 2);
  const moved = (parent) => parent > goes ? parent - 1 : parent;
  const left = [];
  joints.forEach((joint, j) => {
    if (j === goes) return;
    const parent = joint.parent === goes ? stays : joint.parent;
    left.push({...joint, parent: moved(parent), position: j === stays ? middle : joint.position});
  });
  return {joints: left, chosen: moved(stays), renamed: new Map([[joints[goes].name, joints[stays].name]]), keeps: joints[goes].parent === stays};
}

// A joint and all below it on the other side of the plane of constant x through the root. Joints of the other side's
// names move there; those that are missing are added. size: of the mesh
export function mirrored(before, chosen, size) {
  if (chosen < 0) return undefined;
  const joints = before.map((joint) => ({...joint}));
  const middle = joints.find((joint) => joint.parent < 0).position[0];
  const below = (j) => j === chosen || (joints[j].parent >= 0 && below(joints[j].parent));
  const named = (name) => joints.findIndex((joint) => joint.name === name);
  const twins = new Map();
  for (const j of before.keys()) {
    if (!below(j)) continue;
    const {name, position} = joints[j], there = [2 * middle - position[0], position[1], position[2]];
    if (Math.abs(position[0] - middle) < 0.01 * size) {
      twins.set(j, j);  // in the middle: its own twin
      continue;
    }
    const known = named(otherSide(name));
    twins.set(j, known >= 0 ? known : joints.length);
    if (known >= 0) joints[known].position = there;
    else joints.push({name: otherSide(name), parent: -2, position: there, of: j});
  }
  for (const joint of joints) {
    if (joint.of === undefined) continue;
    const above = joints[joint.of].parent;
    const twin = above < 0 ? joint.of : twins.get(above) ?? named(otherSide(joints[above].name));
    joint.parent = twin >= 0 ? twin : above;
    delete joint.of;
  }
  return {joints, chosen: twins.get(chosen)};
}
