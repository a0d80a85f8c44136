#include "anigen/eval/comparison/report_page.h"

#include "anigen/core/html.h"
#include "anigen/eval/tables.h"

namespace anigen::eval {
namespace {

constexpr const char kStyle[] = R"(
body{font:15px/1.45 sans-serif;max-width:1180px;margin:2em auto;padding:0 1em;color:#222;overflow-wrap:anywhere}
table{border-collapse:collapse;overflow-wrap:normal;margin:.6em 0;font-variant-numeric:tabular-nums}
th,td{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}
th:first-child,td:first-child{text-align:left}
table.sortable th{cursor:pointer;user-select:none}table.sortable th[data-order]::after{content:" ▲"}
table.sortable th[data-order=down]::after{content:" ▼"}
.wide{overflow-x:auto}figure{margin:1.2em 0;padding:.6em;border:1px solid #e3e3e3;border-radius:6px}
figcaption{margin-bottom:.4em}.turn{background-repeat:no-repeat;cursor:ew-resize;touch-action:none}
canvas{display:block;background:#eef0f2;touch-action:none;cursor:grab}button{margin:.4em 0}
code{background:#f3f3f3}pre{overflow-x:auto}svg,img,canvas{max-width:100%}.failed{color:#a22}.hint{color:#777;font-size:90%})";

// Sorting: numbers by value, cells without one last in either direction.
constexpr const char kSort[] = R"(
for(const table of document.querySelectorAll('table.sortable')){
 const heads=[...table.tHead.rows[0].cells];
 heads.forEach((head,column)=>head.addEventListener('click',()=>{
  const order=head.dataset.order==='down'?'up':'down';
  heads.forEach(h=>delete h.dataset.order);head.dataset.order=order;
  const key=row=>{const text=row.cells[column].textContent.trim();const n=Number(text);return text===''||Number.isNaN(n)?text:n;};
  const rows=[...table.tBodies[0].rows];
  rows.sort((a,b)=>{const x=key(a),y=key(b);
   if(typeof x!==typeof y)return typeof x==='number'?-1:1;
   const c=typeof x==='number'?x-y:x.localeCompare(y);return order==='down'?-c:c;});
  rows.forEach(r=>table.tBodies[0].appendChild(r));
 }));
})";

// A turntable is a strip of views; dragging picks one. A motion is one of frames that also plays, until it is touched.
constexpr const char kTurn[] = R"(
for(const turn of document.querySelectorAll('.turn')){
 const views=+turn.dataset.views,height=turn.clientHeight;let view=0,from=null;
 const show=()=>turn.style.backgroundPositionY=-view*height+'px';
 turn.addEventListener('pointerdown',e=>{from=[e.clientX,view];turn.setPointerCapture(e.pointerId);});
 turn.addEventListener('pointermove',e=>{if(!from)return;
  view=((Math.round(from[1]+(e.clientX-from[0])/24)%views)+views)%views;show();});
 turn.addEventListener('pointerup',()=>from=null);
 if(turn.dataset.play){const timer=setInterval(()=>{view=(view+1)%views;show();},1000/turn.dataset.play);
  turn.addEventListener('pointerdown',()=>clearInterval(timer));}
})";

// Two shapes side by side in one WebGL 2 canvas under one camera: positions are 16-bit in the box [-1, 1], normals come
// from screen derivatives, joints are drawn as lines over the surface.
constexpr const char kView[] = R"(
function bytes(text){const b=atob(text),a=new Uint8Array(b.length);for(let i=0;i<b.length;i++)a[i]=b.charCodeAt(i);return a.buffer;}
function open3d(button){
 const data=JSON.parse(document.getElementById(button.dataset.shape).textContent);
 const canvas=document.createElement('canvas');canvas.width=960;canvas.height=460;button.replaceWith(canvas);
 const gl=canvas.getContext('webgl2',{antialias:true,preserveDrawingBuffer:true});
 if(!gl){canvas.replaceWith('This browser has no WebGL 2.');return;}
 const compile=(type,source)=>{const s=gl.createShader(type);gl.shaderSource(s,source);gl.compileShader(s);return s;};
 const program=gl.createProgram();
 gl.attachShader(program,compile(gl.VERTEX_SHADER,`#version 300 es
  in vec3 p;uniform mat4 m;uniform mat3 r;out vec3 q;void main(){q=r*p;gl_Position=m*vec4(p,1.);gl_PointSize=3.;}`));
 gl.attachShader(program,compile(gl.FRAGMENT_SHADER,`#version 300 es
  precision highp float;in vec3 q;uniform vec4 color;out vec4 o;void main(){
  if(color.a<.5){vec3 n=normalize(cross(dFdx(q),dFdy(q)));float d=.35+.65*abs(n.y*.8+n.z*.5);o=vec4(color.rgb*d,1.);}else o=vec4(color.rgb,1.);}`));
 gl.linkProgram(program);gl.useProgram(program);
 const at=gl.getAttribLocation(program,'p'),uniform=name=>gl.getUniformLocation(program,name);
 const shapes=data.map(shape=>{
  const points=new Float32Array(Array.from(new Int16Array(bytes(shape.vertices)),v=>v/32767));
  const make=(target,array)=>{const b=gl.createBuffer();gl.bindBuffer(target,b);gl.bufferData(target,array,gl.STATIC_DRAW);return b;};
  const faces=new Uint32Array(bytes(shape.faces)),bones=new Float32Array(bytes(shape.bones));
  return{points:make(gl.ARRAY_BUFFER,points),count:points.length/3,faces:make(gl.ELEMENT_ARRAY_BUFFER,faces),
   indices:faces.length,bones:make(gl.ARRAY_BUFFER,bones),ends:bones.length/3};});
 let yaw=.6,pitch=.25,zoom=1.7,from=null;
 const draw=()=>{
  gl.enable(gl.DEPTH_TEST);gl.viewport(0,0,canvas.width,canvas.height);gl.clearColor(.93,.94,.95,1);
  gl.clear(gl.COLOR_BUFFER_BIT|gl.DEPTH_BUFFER_BIT);
  const cy=Math.cos(yaw),sy=Math.sin(yaw),cp=Math.cos(pitch),sp=Math.sin(pitch);
  const rows=[[cy,sy,0],[-sp*sy,sp*cy,cp],[-cp*sy,cp*cy,-sp]];
  const half=canvas.width/2,sx=zoom*canvas.height/half;
  const matrix=[rows[0][0]*sx,rows[1][0]*zoom,rows[2][0]*.3,0,rows[0][1]*sx,rows[1][1]*zoom,rows[2][1]*.3,0,
   rows[0][2]*sx,rows[1][2]*zoom,rows[2][2]*.3,0,0,0,0,1];
  gl.uniformMatrix4fv(uniform('m'),false,matrix);
  gl.uniformMatrix3fv(uniform('r'),false,[0,1,2].flatMap(c=>rows.map(r=>r[c])));
  shapes.forEach((s,i)=>{
   gl.viewport(i*half,0,half,canvas.height);
   const use=(buffer,color)=>{gl.bindBuffer(gl.ARRAY_BUFFER,buffer);gl.enableVertexAttribArray(at);
    gl.vertexAttribPointer(at,3,gl.FLOAT,false,0,0);gl.uniform4fv(uniform('color'),color);};
   use(s.points,[.75,.78,.82,s.indices?0:1]);
   if(s.indices){gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER,s.faces);gl.drawElements(gl.TRIANGLES,s.indices,gl.UNSIGNED_INT,0);}
   else gl.drawArrays(gl.POINTS,0,s.count);
   gl.clear(gl.DEPTH_BUFFER_BIT);use(s.bones,i?[.85,.25,.1,1]:[.05,.35,.8,1]);gl.drawArrays(gl.LINES,0,s.ends);
  });};
 canvas.addEventListener('pointerdown',e=>{from=[e.clientX,e.clientY,yaw,pitch];canvas.setPointerCapture(e.pointerId);});
 canvas.addEventListener('pointermove',e=>{if(!from)return;yaw=from[2]+(e.clientX-from[0])*.01;
  pitch=Math.max(-1.5,Math.min(1.5,from[3]+(e.clientY-from[1])*.01));draw();});
 canvas.addEventListener('pointerup',()=>from=null);
 canvas.addEventListener('wheel',e=>{e.preventDefault();zoom*=Math.exp(-e.deltaY*.001);draw();},{passive:false});
 draw();
})";

}  // namespace

std::string page_begin(const std::string& title) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
         "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>" +
         html_escaped(title) + "</title><style>" + kStyle + "</style></head><body>\n<h1>" + html_escaped(title) +
         "</h1>\n";
}

std::string page_end() { return std::string("<script>") + kSort + kTurn + kView + "</script></body></html>\n"; }

}  // namespace anigen::eval
