#include "anigen/eval/comparison_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numeric>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/table.h"
#include "anigen/eval/method_differences.h"
#include "anigen/eval/skeleton_groups.h"
#include "anigen/geometry/bones.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/metrics/deformation.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/motion.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::eval {

namespace {

constexpr const char kComparisonStyle[] = R"(
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

namespace fs = std::filesystem;

constexpr const char* kTruth = "ground truth";
constexpr std::size_t kMostViewedFaces = 60000;
constexpr int kQuality = 85;               ///< of JPEG strips
constexpr std::size_t kMostInReport = 24;  ///< frames: a strip of more would not fit into one picture

bool can_move(const io::RiggedShape& shape) { return shape.has_skin() && shape.has_surface(); }

Asset moving(const io::RiggedShape& shape, const metrics::Motion& motion) {
  Asset asset = to_asset(shape);
  asset.animations = {metrics::to_animation(metrics::retarget(motion, joint_tree(asset.skeleton)), asset.skeleton)};
  return asset;
}

const std::vector<double>& times_of(const Asset& asset) { return asset.animations.front().channels.front().times; }

Pose pose_at(const Asset& asset, double time) { return sample(asset.animations.front(), asset.skeleton, time); }

Box box_of_motion(const Asset& asset) {
  Box box;
  for (const double time : times_of(asset)) {
    for (const Eigen::Vector3f& vertex : skin_vertices(asset, pose_at(asset, time))) box.extend(vertex.cast<double>());
  }
  return box;
}

render::PictureOptions plain_picture(int size, render::PictureMode mode = render::PictureMode::kWeights) {
  render::PictureOptions options;
  options.width = options.height = size;
  options.ambient_occlusion = false;
  options.mode = mode;
  return options;
}

/// Tiles in so many columns without gaps, for page scripts to scroll.
io::Image strip_of(const std::vector<render::Tile>& tiles, int columns) {
  render::SheetOptions sheet;
  sheet.columns = columns;
  sheet.gap = 0;
  return render::contact_sheet(tiles, sheet);
}

render::Tile tile_of(const MovingRig& rig, double time, const Box& box, int size) {
  if (!rig.asset) return {io::Image(size, size), rig.label + ": none"};
  render::PictureOptions options = plain_picture(size);
  options.view.fit = box;
  render::set_pose(options, *rig.asset, pose_at(*rig.asset, time));
  return {render::render(*rig.asset, options), rig.label};
}

const MetricInfo* ordering_metric(const Comparison& comparison, const std::string& wanted) {
  if (!wanted.empty()) {
    const MetricInfo* metric = find_metric(wanted);
    if (metric == nullptr)
      throw InputError("", wanted, "no such metric to order assets by; docs/metrics.md lists them");
    return metric;
  }
  const std::vector<const MetricInfo*> present = present_metrics(comparison, true);
  return present.empty() ? nullptr : present.front();
}

std::string asset_rows(const Comparison& comparison, const std::string& worst_by) {
  const std::vector<const MetricInfo*> metrics = present_metrics(comparison, false);
  std::string text = "<div class=\"wide\"><table class=\"sortable\"><thead><tr><th>asset</th><th>method</th>";
  for (const MetricInfo* column : metrics)
    text += "<th title=\"" + html_escaped(column->key + ", " + column->unit) + "\">" +
            html_escaped(column->label + " " + arrow(column->better)) + "</th>";
  text += "<th>reason</th></tr></thead><tbody>\n";
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    for (const std::size_t i : worst_first(comparison, m, worst_by)) {
      const PairResult& result = comparison.results[m][i];
      text += "<tr><td>" + html_escaped(result.id) + "</td><td>" + html_escaped(comparison.methods[m]) + "</td>";
      for (const MetricInfo* column : metrics) text += "<td>" + anigen::fixed(result.value(column->key)) + "</td>";
      text += "<td class=\"failed\">" + html_escaped(result.failure) + "</td></tr>\n";
    }
  }
  return text + "</tbody></table></div>\n";
}

std::string caption(const Comparison& comparison, std::size_t method, const PairResult& result) {
  std::string text = "<figcaption><b>" + html_escaped(result.id) + "</b>, " + html_escaped(comparison.methods[method]);
  for (const MetricInfo* metric : present_metrics(comparison, true)) {
    const double value = result.value(metric->key);
    if (std::isfinite(value)) text += " · " + html_escaped(metric->label) + " " + anigen::fixed(value);
  }
  return text + "</figcaption>\n";
}

template <typename T>
std::string encoded(const std::vector<T>& values) {
  std::vector<std::uint8_t> bytes(values.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return base64(bytes);
}

/// Places are shown in the box [-1, 1], which holds the unit box and whatever a bad prediction puts next to it.
std::int16_t quantized(double x) { return static_cast<std::int16_t>(std::lround(std::clamp(x, -1.0, 1.0) * 32767.0)); }

Json shape_json(const io::RiggedShape& shape) {
  std::vector<std::int16_t> vertices;
  for (const Eigen::Vector3f& v : shape.mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) vertices.push_back(quantized(v[axis]));
  }
  std::vector<std::uint32_t> faces;
  if (shape.mesh.faces.size() <= kMostViewedFaces) {
    for (const Triangle& face : shape.mesh.faces) {
      for (const std::int32_t corner : face) faces.push_back(static_cast<std::uint32_t>(corner));
    }
  }
  std::vector<float> bones;
  if (shape.has_joints()) {
    for (const geometry::Bone& bone : geometry::bones_of(shape.joints.positions, shape.joints.parents)) {
      for (const Eigen::Vector3d& end : {bone.head, bone.tail}) {
        for (int axis = 0; axis < 3; ++axis) bones.push_back(static_cast<float>(end[axis]));
      }
    }
  }
  return {{"vertices", encoded(vertices)}, {"faces", encoded(faces)}, {"bones", encoded(bones)}};
}

/// Pictures need a mesh and a joint; what a shape lacks is not drawn.
std::vector<io::Image> views_of(const io::RiggedShape& shape, int views, int size) {
  render::PictureOptions options = plain_picture(size, render::PictureMode::kColor);
  options.skeleton = shape.has_joints();
  Asset asset;
  if (shape.has_joints()) {
    asset = to_asset(shape);
  } else {
    asset.mesh = shape.mesh;
    asset.materials = shape.materials;
    asset.images = shape.images;
  }
  return render::turntable(asset, options, views);
}

/// The shape with other vertices, every joint a colour.
io::Image picture_of_weights(const io::RiggedShape& shape, std::vector<Eigen::Vector3f> vertices, int size) {
  Asset asset = to_asset(shape);
  asset.mesh.normals = vertex_normals(vertices, asset.mesh.faces);
  asset.mesh.vertices = std::move(vertices);
  return render::render(asset, plain_picture(size));
}

/// A turntable of ground truth beside prediction as one strip of views that page scripts scroll by dragging.
std::string turntable_html(const ComparedShapes& shapes, int views, int size) {
  const std::vector<io::Image> left = views_of(shapes.truth, views, size);
  const std::vector<io::Image> right = views_of(shapes.predicted, views, size);
  std::vector<render::Tile> tiles;
  for (std::size_t i = 0; i < left.size(); ++i) {
    tiles.push_back({left[i], ""});
    tiles.push_back({right[i], ""});
  }
  const std::string strip = base64(io::encode_png(strip_of(tiles, 2)));
  return "<div class=\"turn\" data-views=\"" + std::to_string(views) + "\" style=\"width:" + std::to_string(2 * size) +
         "px;height:" + std::to_string(size) + "px;background-image:url(data:image/png;base64," + strip +
         ")\"></div><div class=\"hint\">left: ground truth, right: prediction; drag to turn</div>\n";
}

/// Both shapes in the same random poses (posed_pair()), each in the colours of its own joints' weights: truth and
/// prediction per pose. Empty unless both have faces, joints and weights. @param seed of the poses
std::string posed_html(const ComparedShapes& shapes, int poses, int size, std::uint64_t seed) {
  if (!can_move(shapes.truth) || !can_move(shapes.predicted)) return "";
  const Eigen::MatrixXd plan = metrics::matching_plan(shapes.predicted.joints, shapes.truth.joints);
  metrics::DeformationOptions options;
  options.seed = seed;
  std::vector<render::Tile> tiles;
  for (int pose = 0; pose < poses; ++pose) {
    metrics::PosedPair posed = metrics::posed_pair(shapes.truth, shapes.predicted, plan, pose, options);
    tiles.push_back({picture_of_weights(shapes.truth, std::move(posed.truth), size), ""});
    tiles.push_back({picture_of_weights(shapes.predicted, std::move(posed.predicted), size), ""});
  }
  const std::vector<std::uint8_t> strip = io::encode_jpeg(strip_of(tiles, 2 * poses), kQuality);
  return "<img style=\"max-width:100%\" alt=\"poses\" src=\"data:image/jpeg;base64," + base64(strip) +
         "\"><div class=\"hint\">the same random poses, each in the colours of its own joints: ground truth, "
         "prediction, ground truth, …</div>\n";
}

/// A button that opens both shapes in 3D; their geometry stands in the page as JSON. Meshes of more than
/// kMostViewedFaces faces are shown as points. @param id unique within the page
std::string view_html(const ComparedShapes& shapes, const std::string& id) {
  const Json data = Json::array({shape_json(shapes.truth), shape_json(shapes.predicted)});
  return "<script type=\"application/json\" id=\"" + id + "\">" + data.dump() +
         "</script><button onclick=\"open3d(this)\" data-shape=\"" + id + "\">3D view</button>\n";
}

std::string pictures(const Comparison& comparison, const ComparisonReportOptions& options) {
  if (!options.shapes || options.pictured == 0) return "";
  std::string text;
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    std::string figures;
    std::size_t drawn = 0;
    for (const std::size_t i : worst_first(comparison, m, options.worst_by)) {
      const PairResult& result = comparison.results[m][i];
      if (drawn == options.pictured) break;
      if (!result.failure.empty()) continue;
      ++drawn;
      figures += "<figure>" + caption(comparison, m, result);
      try {
        const ComparedShapes shapes = options.shapes(m, i);
        figures += turntable_html(shapes, options.views, options.picture_size);
        figures += posed_html(shapes, options.poses, options.picture_size, comparison.seed);
        figures += view_html(shapes, "shape-" + std::to_string(m) + "-" + std::to_string(i));
      } catch (...) {
        figures += "<p class=\"failed\">No picture: " + html_escaped(failure_of_item()) + "</p>";
      }
      figures += "</figure>\n";
    }
    if (!figures.empty()) text += "<h2>Worst first, " + html_escaped(comparison.methods[m]) + "</h2>\n" + figures;
  }
  return text;
}

/// The frames as one picture that page scripts scroll: it plays by itself, and stops and turns to dragging.
std::string motion_html(const MotionStrip& strip) {
  std::string text = "<figure><figcaption><b>" + html_escaped(strip.id) + "</b></figcaption>\n";
  if (strip.frames.empty())
    return text + "<p class=\"failed\">No picture: " + html_escaped(strip.problem) + "</p></figure>\n";
  const std::size_t step = (strip.frames.size() + kMostInReport - 1) / kMostInReport;
  std::vector<render::Tile> tiles;
  for (std::size_t f = 0; f < strip.frames.size(); f += step) tiles.push_back({strip.frames[f], ""});
  constexpr int kPerSecond = 6;
  const std::string picture = base64(io::encode_jpeg(strip_of(tiles, 1), kQuality));
  const io::Image& first = strip.frames.front();
  return text + "<div class=\"turn\" data-views=\"" + std::to_string(tiles.size()) + "\" data-play=\"" +
         std::to_string(kPerSecond) + "\" style=\"width:" + std::to_string(first.width) +
         "px;height:" + std::to_string(first.height) + "px;background-image:url(data:image/jpeg;base64," + picture +
         ")\"></div></figure>\n";
}

std::string motions(const std::vector<MotionStrip>& strips) {
  if (strips.empty()) return "";
  std::string text =
      "<h2>The same motion</h2>\n<p class=\"hint\">Ground truth and predictions at the same times, each in the colours "
      "of its own joints; drag to move by hand.</p>\n";
  for (const MotionStrip& strip : strips) text += motion_html(strip);
  return text;
}

std::string settings_html(const Json& settings) {
  return "<details><summary>Settings, seeds, versions</summary><pre>" + html_escaped(settings.dump(2)) +
         "</pre></details>\n";
}

std::string section(const std::string& title, const anigen::Table& table) {
  if (table.rows.empty()) return "";
  return "<h2>" + html_escaped(title) + "</h2>\n<div class=\"wide\">" + anigen::to_html(table) + "</div>\n";
}

}  // namespace

std::string page_begin(const std::string& title) {
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
         "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\"><title>" +
         html_escaped(title) + "</title><style>" + kComparisonStyle + "</style></head><body>\n<h1>" +
         html_escaped(title) + "</h1>\n";
}

std::string page_end() { return std::string("<script>") + kSort + kTurn + kView + "</script></body></html>\n"; }

std::vector<MovingRig> moving_rigs(const std::vector<MotionRow>& rows, const PairSettings& settings,
                                   const metrics::Motion* given) {
  std::vector<MovingRig> rigs(1);
  rigs[0].label = kTruth;
  for (const MotionRow& row : rows) {
    rigs.push_back({row.label, std::nullopt});
    if (!row.shapes || !can_move(row.shapes->truth) || !can_move(row.shapes->predicted)) continue;
    const metrics::Motion motion = same_motion(*row.shapes, settings, given).truth;
    if (!rigs[0].asset) rigs[0].asset = moving(row.shapes->truth, motion);
    rigs.back().asset = moving(row.shapes->predicted, motion);
  }
  if (!rigs[0].asset) throw InputError("", "", "no prediction of it that could move beside the ground truth");
  return rigs;
}

std::vector<io::Image> motion_frames(const std::vector<MovingRig>& rigs, int size) {
  const Box box = box_of_motion(*rigs[0].asset);
  render::SheetOptions sheet;
  constexpr std::size_t kColumns = 5;
  sheet.columns = static_cast<int>(std::min(rigs.size(), kColumns));
  sheet.gap = 4;
  std::vector<io::Image> frames;
  for (const double time : times_of(*rigs[0].asset)) {
    std::vector<render::Tile> tiles;
    for (const MovingRig& rig : rigs) tiles.push_back(tile_of(rig, time, box, size));
    frames.push_back(render::contact_sheet(tiles, sheet));
  }
  return frames;
}

void write_motion(const fs::path& folder, const std::vector<MovingRig>& rigs, const std::vector<io::Image>& frames) {
  char name[32];
  const auto frame_file = [&](std::size_t f) {
    std::snprintf(name, sizeof name, "frame_%03zu.png", f);
    return folder / name;
  };
  for (std::size_t f = 0; f < frames.size(); ++f) io::write_png(frame_file(f), frames[f]);
  // Of an earlier run with more frames.
  std::error_code ignored;
  for (std::size_t f = frames.size(); fs::remove(frame_file(f), ignored); ++f) {
  }
  for (std::size_t r = 0; r < rigs.size(); ++r) {
    if (rigs[r].asset)
      io::write_gltf(folder / ((r == 0 ? "truth" : file_name(rigs[r].label)) + ".glb"), *rigs[r].asset);
  }
}

std::vector<std::size_t> worst_first(const Comparison& comparison, std::size_t method, const std::string& worst_by) {
  const MetricInfo* metric = ordering_metric(comparison, worst_by);
  const auto& results = comparison.results[method];
  std::vector<std::size_t> order(results.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto badness = [&](std::size_t i) {
    if (!results[i].failure.empty()) return 1e300;
    const double value = metric == nullptr ? NAN : results[i].value(metric->key);
    if (!std::isfinite(value)) return -1e300;
    return metric->better == Better::kHigher ? -value : value;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return badness(a) > badness(b); });
  return order;
}

std::string comparison_report(const Comparison& comparison, const ComparisonReportOptions& options) {
  const MetricInfo* metric = ordering_metric(comparison, options.worst_by);
  std::string html = page_begin(options.title) + settings_html(comparison.settings);
  html += section(std::to_string(comparison.ids.size()) + " ground truths",
                  method_table(comparison, present_metrics(comparison, true)));
  const std::string transport = transport_text(comparison);
  if (!transport.empty()) html += "<p class=\"hint\">" + html_escaped(transport) + "</p>\n";
  if (const auto skeletons = by_skeleton(comparison))
    html += section("Every skeleton once: mean ± half of the 95 % interval over skeletons",
                    skeleton_mean_table(*skeletons, comparison));
  html += section("Pairs", pairing_table(comparison));
  html += section("Differences to " + comparison.methods[0], difference_table(comparison));
  html += motions(options.motions);
  html += pictures(comparison, options);
  html += "<h2>All assets</h2>\n<p class=\"hint\">Worst first" +
          (metric == nullptr ? "" : " by " + html_escaped(metric->label)) + "; click a column to sort.</p>\n" +
          asset_rows(comparison, options.worst_by);
  for (std::size_t m = 0; m < comparison.methods.size(); ++m)
    html += section("All metrics, " + comparison.methods[m], metric_summary_table(comparison, m));
  html += section("Not computed", reason_table(comparison));
  return html + page_end();
}

}  // namespace anigen::eval
