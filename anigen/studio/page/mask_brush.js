// The mask over an image, painted and erased by mouse or finger. The mask is kept as the opacity of a canvas of the
// image's size; strokes are kept as well, so that each can be taken back.
import {$, ask} from '/base.js';

const kMostShown = 1024;  // pixels of the longer side on the screen

const canvasOf = (width, height) => Object.assign(document.createElement('canvas'), {width, height});

async function decoded(path) {
  const bytes = await (await ask(path)).blob();
  try {
    return await createImageBitmap(bytes);
  } catch {
    throw new Error('this browser cannot show the image; send it as PNG, JPEG or WebP to paint its mask');
  }
}

// Opacity from the brightness of a mask; where none is known yet, from the image's own opacity.
function opacityOf(image, mask) {
  const canvas = canvasOf(image.width, image.height), context = canvas.getContext('2d', {willReadFrequently: true});
  context.drawImage(mask ?? image, 0, 0, canvas.width, canvas.height);
  const pixels = context.getImageData(0, 0, canvas.width, canvas.height), {data} = pixels;
  for (let i = 0; i < data.length; i += 4) {
    const inside = mask ? data[i] : data[i + 3];
    data[i] = data[i + 1] = data[i + 2] = 255;
    data[i + 3] = inside > 127 ? 255 : 0;
  }
  context.putImageData(pixels, 0, 0);
  return canvas;
}

class MaskPainter {
  constructor(image, mask) {
    this.image = image;
    this.found = opacityOf(image, mask);
    this.mask = canvasOf(image.width, image.height);
    this.strokes = [];
    $('mask_canvas').style.width = `min(100%, ${(62 * image.width / image.height).toFixed(1)}vh)`;
    const scale = Math.min(1, kMostShown / Math.max(image.width, image.height));
    [$('mask_canvas').width, $('mask_canvas').height] = [image.width, image.height].map((side) => Math.max(1, Math.round(side * scale)));
    this.replay();
  }

  stamp({tool, points, radius}) {
    const context = this.mask.getContext('2d');
    context.globalCompositeOperation = tool === 'add' ? 'source-over' : 'destination-out';
    context.lineCap = context.lineJoin = 'round';
    context.lineWidth = 2 * radius;
    context.strokeStyle = '#fff';
    context.beginPath();
    context.moveTo(...points[0]);
    for (const point of points) context.lineTo(...point);
    context.stroke();
    context.globalCompositeOperation = 'source-over';
  }

  // The mask from what was found and all strokes.
  replay() {
    const context = this.mask.getContext('2d');
    context.clearRect(0, 0, this.mask.width, this.mask.height);
    context.drawImage(this.found, 0, 0);
    for (const stroke of this.strokes) this.apply(stroke);
    this.draw();
  }
  apply(stroke) {
    if (stroke.tool !== 'all' && stroke.tool !== 'none') return this.stamp(stroke);
    const context = this.mask.getContext('2d');
    context.clearRect(0, 0, this.mask.width, this.mask.height);
    context.fillStyle = '#fff';
    if (stroke.tool === 'all') context.fillRect(0, 0, this.mask.width, this.mask.height);
  }
  add(stroke) {
    this.strokes.push(stroke);
    this.apply(stroke);
    this.draw();
  }
  undo() {
    this.strokes.pop();
    this.replay();
  }

  draw() {
    const shown = $('mask_canvas'), {width, height} = shown, context = shown.getContext('2d');
    const object = canvasOf(width, height), layer = object.getContext('2d');
    layer.drawImage(this.image, 0, 0, width, height);
    layer.globalCompositeOperation = 'destination-in';
    layer.drawImage(this.mask, 0, 0, width, height);
    context.fillStyle = '#301020';
    context.fillRect(0, 0, width, height);
    context.globalAlpha = 0.3;
    context.drawImage(this.image, 0, 0, width, height);
    context.globalAlpha = 1;
    context.drawImage(object, 0, 0);
    shown.dataset.strokes = this.strokes.length;
  }

  place(event) {
    const box = $('mask_canvas').getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * this.mask.width, (event.clientY - box.top) / box.height * this.mask.height];
  }

  press(event) {
    if (event.button !== 0 || !event.isPrimary) return;
    event.preventDefault();
    const canvas = $('mask_canvas');
    canvas.setPointerCapture(event.pointerId);
    const radius = Number($('mask_size').value) / 200 * Math.max(this.mask.width, this.mask.height);
    const stroke = {tool: $('mask_add').checked ? 'add' : 'erase', points: [this.place(event)], radius};
    this.add(stroke);
    const move = (next) => {
      stroke.points.push(this.place(next));
      this.stamp({...stroke, points: stroke.points.slice(-2)});
      this.draw();
    };
    const up = () => {
      canvas.removeEventListener('pointermove', move);
      canvas.removeEventListener('lostpointercapture', up);
    };
    canvas.addEventListener('pointermove', move);
    canvas.addEventListener('lostpointercapture', up);
  }

  // White is the object.
  async file() {
    const whole = canvasOf(this.mask.width, this.mask.height), context = whole.getContext('2d');
    context.fillStyle = '#000';
    context.fillRect(0, 0, whole.width, whole.height);
    context.drawImage(this.mask, 0, 0);
    const bytes = await new Promise((resolve) => whole.toBlob(resolve, 'image/png'));
    return new File([bytes], 'mask.png', {type: 'image/png'});
  }
}

let painter;

export function startMaskBrush() {
  $('mask_canvas').addEventListener('pointerdown', (event) => painter?.press(event));
  $('mask_undo').addEventListener('click', () => painter.undo());
  $('mask_all').addEventListener('click', () => painter.add({tool: 'all'}));
  $('mask_none').addEventListener('click', () => painter.add({tool: 'none'}));
  $('mask_apply').addEventListener('click', () => $('mask_dialog').close('apply'));
  $('mask_close').addEventListener('click', () => $('mask_dialog').close(''));
}

// Lets people paint the mask of an image. Returns it as a PNG; undefined when they close without. Both are paths; mask may
// be undefined.
export async function openMask(image, mask) {
  painter = new MaskPainter(await decoded(image), mask && await decoded(mask));
  const dialog = $('mask_dialog');
  dialog.returnValue = '';
  dialog.showModal();
  await new Promise((resolve) => dialog.addEventListener('close', resolve, {once: true}));
  const made = dialog.returnValue === 'apply' ? await painter.file() : undefined;
  painter = undefined;
  return made;
}
