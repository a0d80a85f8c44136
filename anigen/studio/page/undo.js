// Steps back and forth of an editor, which has snapshot() and restore(snapshot).
const kMostUndo = 200;

export class Undoable {
  past = [];
  undone = [];

  forgetSteps() {
    this.past = [];
    this.undone = [];
  }

  // Before each change.
  remember() {
    this.past.push(this.snapshot());
    if (this.past.length > kMostUndo) this.past.shift();
    this.undone = [];
  }
  // Both say whether there was a step.
  undo() { return this.step(this.past, this.undone); }
  redo() { return this.step(this.undone, this.past); }
  step(from, to) {
    if (from.length === 0) return false;
    to.push(this.snapshot());
    this.restore(from.pop());
    return true;
  }
}
