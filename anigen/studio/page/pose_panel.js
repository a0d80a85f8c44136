// Controls of the pose: undo, reset, length of the chain that turns.
import {$, state} from '/base.js';
import {clipName} from '/motions.js';

function show() {
  $('pose_undo').disabled = state.poser.past.length === 0;
  $('pose_redo').disabled = state.poser.undone.length === 0;
}
export const poseActions = {changed: show, chain: () => Number($('chain').value)};

export const openPose = () => state.poser.open();
export function closePose() {
  state.poser.close();
  state.stage.play(clipName());
}

export function startPose() {
  $('pose_undo').addEventListener('click', () => state.poser.undo());
  $('pose_redo').addEventListener('click', () => state.poser.redo());
  $('pose_reset').addEventListener('click', () => state.poser.reset());
  document.addEventListener('keydown', (event) => {
    if (state.tab !== 'pose' || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== 'z') return;
    event.preventDefault();
    $(event.shiftKey ? 'pose_redo' : 'pose_undo').click();
  });
}
