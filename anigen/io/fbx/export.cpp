#include "anigen/io/fbx/export.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/core/version.h"
#include "anigen/io/file_asset.h"
#include "anigen/io/linear_keys.h"

namespace anigen::io::fbx_export {

Scene::Scene() : objects("Objects"), connections("Connections") {}

Record& Scene::object(const std::string& record, const std::string& name, const std::string& type,
                      const std::string& kind, std::int64_t& id) {
  id = next_id_++;
  const auto known = std::find_if(counts_.begin(), counts_.end(), [&](const auto& one) { return one.first == record; });
  if (known != counts_.end())
    ++known->second;
  else
    counts_.emplace_back(record, 1);
  return objects.child(record).int64(id).text(name + std::string("\0\1", 2) + type).text(kind);
}

void Scene::connect(std::int64_t child, std::int64_t parent) {
  connections.child("C").text("OO").int64(child).int64(parent);
}

void Scene::connect(std::int64_t child, std::int64_t parent, const std::string& property) {
  connections.child("C").text("OP").int64(child).int64(parent).text(property);
}

void set_int(Record& properties, const std::string& name, int value, const std::string& type) {
  properties.child("P").text(name).text(type).text(type == "int" ? "Integer" : "").text("").int32(value);
}

void set_real(Record& properties, const std::string& name, double value) {
  properties.child("P").text(name).text("double").text("Number").text("").real(value);
}

void set_vector(Record& properties, const std::string& name, const Eigen::Vector3d& value, const std::string& type,
                const std::string& flags) {
  Record& record = properties.child("P").text(name).text(type).text("").text(flags);
  for (const double x : value) record.real(x + 0.0);
}

void set_text(Record& properties, const std::string& name, const std::string& value) {
  properties.child("P").text(name).text("KString").text("").text("").text(value);
}

void set_time(Record& properties, const std::string& name, double seconds) {
  properties.child("P").text(name).text("KTime").text("Time").text("").int64(ticks(seconds));
}

std::int64_t ticks(double seconds) { return std::llround(seconds * kTicksPerSecond); }

namespace {

using Matrix4d = Eigen::Matrix4d;

// The format's matrices multiply rows from the right: transposed, row by row, they are our columns.
std::vector<double> numbers_of(const Matrix4d& matrix) { return {matrix.data(), matrix.data() + 16}; }

double srgb_of(float linear) {
  const double x = std::clamp(static_cast<double>(linear), 0.0, 1.0);
  return x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1.0 / 2.4) - 0.055;
}

/// A layer element whose values the corners of faces share by an index: a vertex is a value.
Record& indexed_layer(Record& geometry, const std::string& type, const std::string& name) {
  Record& layer = geometry.child(type).int32(0);
  layer.child("Version").int32(101);
  layer.child("Name").text(name);
  layer.child("MappingInformationType").text("ByPolygonVertex");
  layer.child("ReferenceInformationType").text("IndexToDirect");
  return layer;
}

void add_normals(const Mesh& mesh, Record& geometry) {
  Record& layer = geometry.child("LayerElementNormal").int32(0);
  layer.child("Version").int32(101);
  layer.child("Name").text("");
  layer.child("MappingInformationType").text("ByPolygonVertex");
  layer.child("ReferenceInformationType").text("Direct");  // some readers know no other
  std::vector<double> normals;
  for (const Triangle& face : mesh.faces) {
    for (const std::int32_t v : face) {
      for (const float x : mesh.normals[at(v)]) normals.push_back(static_cast<double>(x));
    }
  }
  layer.child("Normals").array(normals);
}

void add_surface_layers(const Mesh& mesh, const std::vector<int>& materials, Record& geometry) {
  std::vector<std::int32_t> corners;
  for (const Triangle& face : mesh.faces) corners.insert(corners.end(), face.begin(), face.end());
  std::vector<std::string> layers;
  if (!mesh.normals.empty()) {
    add_normals(mesh, geometry);
    layers.emplace_back("LayerElementNormal");
  }
  if (!mesh.colors.empty()) {
    Record& layer = indexed_layer(geometry, "LayerElementColor", "Color");
    std::vector<double> colors;
    for (const Eigen::Vector4f& color : mesh.colors) {
      for (int k = 0; k < 3; ++k) colors.push_back(srgb_of(color[k]));
      colors.push_back(std::clamp(static_cast<double>(color[3]), 0.0, 1.0));
    }
    layer.child("Colors").array(colors);
    layer.child("ColorIndex").array(corners);
    layers.emplace_back("LayerElementColor");
  }
  if (!mesh.uvs.empty()) {
    Record& layer = indexed_layer(geometry, "LayerElementUV", "UVMap");
    std::vector<double> uvs;
    for (const Eigen::Vector2f& uv : mesh.uvs) {  // counted from the bottom of the picture
      uvs.push_back(static_cast<double>(uv.x()));
      uvs.push_back(1.0 - static_cast<double>(uv.y()));
    }
    layer.child("UV").array(uvs);
    layer.child("UVIndex").array(corners);
    layers.emplace_back("LayerElementUV");
  }
  Record& layer = geometry.child("LayerElementMaterial").int32(0);
  layer.child("Version").int32(101);
  layer.child("Name").text("");
  layer.child("MappingInformationType").text(materials.size() > 1 ? "ByPolygon" : "AllSame");
  layer.child("ReferenceInformationType").text("IndexToDirect");
  std::vector<std::int32_t> of_faces(1, 0);
  if (materials.size() > 1) {
    of_faces.clear();
    for (const std::int32_t material : mesh.face_materials) {
      const auto place = std::lower_bound(materials.begin(), materials.end(), material);
      of_faces.push_back(static_cast<std::int32_t>(place - materials.begin()));
    }
  }
  layer.child("Materials").array(of_faces);
  layers.emplace_back("LayerElementMaterial");
  Record& list = geometry.child("Layer").int32(0);
  list.child("Version").int32(100);
  for (const std::string& type : layers) {
    Record& element = list.child("LayerElement");
    element.child("Type").text(type);
    element.child("TypedIndex").int32(0);
  }
}

std::int64_t add_geometry(const Mesh& mesh, const std::string& name, const std::vector<int>& materials, Scene& scene) {
  std::int64_t id = 0;
  Record& geometry = scene.object("Geometry", name, "Geometry", "Mesh", id);
  geometry.child("Properties70");
  geometry.child("GeometryVersion").int32(124);
  std::vector<double> vertices;
  for (const Eigen::Vector3f& v : mesh.vertices) {
    for (const float x : v) vertices.push_back(static_cast<double>(x));
  }
  std::vector<std::int32_t> polygons;
  for (const Triangle& face : mesh.faces) polygons.insert(polygons.end(), {face[0], face[1], -1 - face[2]});
  geometry.child("Vertices").array(vertices);
  geometry.child("PolygonVertexIndex").array(polygons);
  add_surface_layers(mesh, materials, geometry);
  return id;
}

/// A node of the scene. @param local where it stands below its parent
std::int64_t add_model(const std::string& name, const std::string& kind, const Transform& local, std::int64_t parent,
                       Scene& scene) {
  constexpr int kRSrs = 1;  // scales and rotations of parents multiply as matrices do
  std::int64_t id = 0;
  Record& model = scene.object("Model", name, "Model", kind, id);
  model.child("Version").int32(232);
  Record& properties = model.child("Properties70");
  set_int(properties, "InheritType", kRSrs, "enum");
  set_int(properties, "DefaultAttributeIndex", 0);
  set_vector(properties, "Lcl Translation", local.translation, "Lcl Translation");
  set_vector(properties, "Lcl Rotation", euler_degrees(local.rotation.toRotationMatrix()), "Lcl Rotation");
  set_vector(properties, "Lcl Scaling", local.scale, "Lcl Scaling");
  model.child("Shading").flag(true);
  model.child("Culling").text("CullingOff");
  scene.connect(id, parent);
  return id;
}

void add_attribute(const std::string& name, const std::string& kind, const std::string& flags, std::int64_t model,
                   Scene& scene) {
  std::int64_t id = 0;
  Record& attribute = scene.object("NodeAttribute", name, "NodeAttribute", kind, id);
  attribute.child("TypeFlags").text(flags);
  scene.connect(id, model);
}

std::vector<std::int64_t> add_joints(const Skeleton& skeleton, std::int64_t root, Scene& scene) {
  std::vector<std::int64_t> ids;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const int parent = skeleton.parents[j];
    ids.push_back(
        add_model(skeleton.names[j], "LimbNode", skeleton.rest[j], parent < 0 ? root : ids[at(parent)], scene));
    add_attribute(skeleton.names[j], "LimbNode", "Skeleton", ids.back(), scene);
  }
  return ids;
}

/// A skin with a cluster per joint, of joints without weights too.
void add_skin(const Asset& asset, const std::string& name, const std::vector<std::int64_t>& joints,
              std::int64_t geometry, Scene& scene) {
  std::vector<std::vector<std::int32_t>> vertices(joints.size());
  std::vector<std::vector<double>> weights(joints.size());
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      vertices[at(influence.joint)].push_back(static_cast<std::int32_t>(v));
      weights[at(influence.joint)].push_back(static_cast<double>(influence.weight));
    }
  }
  std::int64_t skin = 0;
  Record& deformer = scene.object("Deformer", name, "Deformer", "Skin", skin);
  deformer.child("Version").int32(101);
  deformer.child("Link_DeformAcuracy").real(50.0);
  scene.connect(skin, geometry);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    std::int64_t id = 0;
    Record& cluster = scene.object("Deformer", asset.skeleton.names[j], "SubDeformer", "Cluster", id);
    cluster.child("Version").int32(100);
    cluster.child("UserData").text("").text("");
    if (!vertices[j].empty()) {
      cluster.child("Indexes").array(vertices[j]);
      cluster.child("Weights").array(weights[j]);
    }
    const Matrix4d& bind = asset.skeleton.bind[j];
    cluster.child("Transform").array(numbers_of(bind.inverse()));
    cluster.child("TransformLink").array(numbers_of(bind));
    scene.connect(id, skin);
    scene.connect(joints[j], id);
  }
}

/// @param nodes with their world matrices
void add_bind_pose(const std::string& name, const std::vector<std::pair<std::int64_t, Matrix4d>>& nodes, Scene& scene) {
  std::int64_t id = 0;
  Record& pose = scene.object("Pose", name, "Pose", "BindPose", id);
  pose.child("Type").text("BindPose");
  pose.child("Version").int32(100);
  pose.child("NbPoseNodes").int32(static_cast<std::int32_t>(nodes.size()));
  for (const auto& [node, matrix] : nodes) {
    Record& entry = pose.child("PoseNode");
    entry.child("Node").int64(node);
    entry.child("Matrix").array(numbers_of(matrix));
  }
}

/// Materials of one file, and each image once.
class Materials {
 public:
  Materials(const Asset& asset, const std::string& file, Scene& scene) : asset_(asset), file_(file), scene_(scene) {}

  void add(int material, std::int64_t model) {
    const Material look = material_or_default(asset_, material);
    std::int64_t id = 0;
    Record& record = scene_.object("Material", look.name, "Material", "", id);
    record.child("Version").int32(102);
    record.child("ShadingModel").text("lambert");
    record.child("MultiLayer").int32(0);
    Record& properties = record.child("Properties70");
    const Eigen::Vector4d color = look.base_color.cast<double>().cwiseMax(0.0).cwiseMin(1.0);
    set_vector(properties, "DiffuseColor", color.head<3>(), "Color");
    set_real(properties, "DiffuseFactor", 1.0);
    set_real(properties, "Opacity", color[3]);
    set_real(properties, "TransparencyFactor", 1.0 - color[3]);
    set_vector(properties, "Diffuse", color.head<3>(), "Vector3D");
    scene_.connect(id, model);
    if (const EncodedImage* image = image_of(asset_, look))
      scene_.connect(texture(look.image, *image), id, "DiffuseColor");
  }

 private:
  std::int64_t texture(int number, const EncodedImage& image) {
    const auto known = textures_.find(number);
    if (known != textures_.end()) return known->second;
    const std::string extension = image_extension(image, file_);
    const std::string name = unused_name(image.name.empty() ? "image" : image.name, names_);
    names_.push_back(name);
    const std::string picture = file_stem(name) + extension;
    std::int64_t video = 0, id = 0;
    Record& clip = scene_.object("Video", name, "Video", "Clip", video);
    clip.child("Type").text("Clip");
    set_text(clip.child("Properties70"), "Path", picture);
    clip.child("UseMipMap").int32(0);
    clip.child("Filename").text(picture);
    clip.child("RelativeFilename").text(picture);
    clip.child("Content").raw({reinterpret_cast<const char*>(image.bytes.data()), image.bytes.size()});
    Record& texture = scene_.object("Texture", name, "Texture", "", id);
    texture.child("Type").text("TextureVideoClip");
    texture.child("Version").int32(202);
    texture.child("TextureName").text(name + std::string("\0\1", 2) + "Texture");
    texture.child("Media").text(name + std::string("\0\1", 2) + "Video");
    texture.child("FileName").text(picture);
    texture.child("RelativeFilename").text(picture);
    set_text(texture.child("Properties70"), "UVSet", "UVMap");
    scene_.connect(video, id);
    textures_[number] = id;
    return id;
  }

  const Asset& asset_;
  const std::string& file_;
  Scene& scene_;
  std::map<int, std::int64_t> textures_;
  std::vector<std::string> names_;
};

void add_header(std::list<Record>& file) {
  const std::string creator = std::string("AniGen in C++ ") + kVersion;
  Record& header = file.emplace_back("FBXHeaderExtension");
  header.child("FBXHeaderVersion").int32(1003);
  header.child("FBXVersion").int32(7400);
  header.child("EncryptionType").int32(0);
  Record& stamp = header.child("CreationTimeStamp");
  stamp.child("Version").int32(1000);
  stamp.child("Year").int32(1970);
  stamp.child("Month").int32(1);
  stamp.child("Day").int32(1);
  stamp.child("Hour").int32(10);
  stamp.child("Minute").int32(0);
  stamp.child("Second").int32(0);
  stamp.child("Millisecond").int32(0);
  header.child("Creator").text(creator);
  file.emplace_back("FileId").raw(file_id());
  file.emplace_back("CreationTime").text(kCreationTime);
  file.emplace_back("Creator").text(creator);
}

/// The number by which the format names a frame rate. @param rate one of frame_rate()
int time_mode(double rate) {
  const std::map<double, int> modes{{120, 1}, {100, 2}, {60, 3}, {50, 4}, {48, 5}, {30, 6}, {25, 10}, {24, 11}};
  return modes.at(rate);
}

void add_settings(const Asset& asset, std::list<Record>& file) {
  Record& settings = file.emplace_back("GlobalSettings");
  settings.child("Version").int32(1000);
  Record& properties = settings.child("Properties70");
  set_int(properties, "UpAxis", 1);
  set_int(properties, "UpAxisSign", 1);
  set_int(properties, "FrontAxis", 2);
  set_int(properties, "FrontAxisSign", 1);
  set_int(properties, "CoordAxis", 0);
  set_int(properties, "CoordAxisSign", 1);
  set_int(properties, "OriginalUpAxis", 1);
  set_int(properties, "OriginalUpAxisSign", 1);
  set_real(properties, "UnitScaleFactor", 100.0);  // centimetres per unit
  set_real(properties, "OriginalUnitScaleFactor", 100.0);
  double last = 0.0;
  for (const Animation& animation : asset.animations) last = std::max(last, animation.duration());
  set_int(properties, "TimeMode", time_mode(frame_rate(asset.animations)), "enum");
  set_time(properties, "TimeSpanStart", 0.0);
  set_time(properties, "TimeSpanStop", last);
  set_real(properties, "CustomFrameRate", -1.0);
}

void add_documents(const std::vector<std::string>& clips, std::list<Record>& file) {
  constexpr std::int64_t kDocument = 999'999;
  Record& documents = file.emplace_back("Documents");
  documents.child("Count").int32(1);
  Record& document = documents.child("Document").int64(kDocument).text("").text("Scene");
  set_text(document.child("Properties70"), "ActiveAnimStackName", clips.empty() ? "" : clips.front());
  document.child("RootNode").int64(kSceneRoot);
  file.emplace_back("References");
}

void add_definitions(const Scene& scene, std::list<Record>& file) {
  Record& definitions = file.emplace_back("Definitions");
  definitions.child("Version").int32(100);
  int total = 1;
  for (const auto& [type, count] : scene.counts()) total += count;
  definitions.child("Count").int32(total);
  definitions.child("ObjectType").text("GlobalSettings").child("Count").int32(1);
  for (const auto& [type, count] : scene.counts())
    definitions.child("ObjectType").text(type).child("Count").int32(count);
}

void add_takes(const Asset& asset, const std::vector<std::string>& clips, std::list<Record>& file) {
  Record& takes = file.emplace_back("Takes");
  takes.child("Current").text(clips.empty() ? "" : clips.front());
  for (std::size_t a = 0; a < clips.size(); ++a) {
    const std::int64_t stop = ticks(asset.animations[a].duration());
    Record& take = takes.child("Take").text(clips[a]);
    take.child("FileName").text(file_stem(clips[a]) + ".tak");
    take.child("LocalTime").int64(0).int64(stop);
    take.child("ReferenceTime").int64(0).int64(stop);
  }
}

void refuse_zero_bytes(const Asset& asset, const std::string& file) {
  const auto check = [&file](const std::string& name, const char* what) {
    if (name.find('\0') != std::string::npos)
      throw NotSupportedError(file, what, "a zero byte in a name of an FBX file");
  };
  check(asset.name, "name of the asset");
  for (const std::string& name : asset.skeleton.names) check(name, "name of a joint");
  for (const Material& material : asset.materials) check(material.name, "name of a material");
  for (const EncodedImage& image : asset.images) check(image.name, "name of an image");
  for (const Animation& animation : asset.animations) check(animation.name, "name of an animation");
}

std::list<Record> records_of(const Asset& asset, const std::string& file) {
  Scene scene;
  std::vector<std::string> names = asset.skeleton.names;  // of nodes: readers find them by name
  names.push_back(unused_name(asset.name.empty() ? "asset" : asset.name, names));
  const std::string name = names.back();
  const std::int64_t root = add_model(name, "Null", {}, kSceneRoot, scene);
  add_attribute(name, "Null", "Null", root, scene);
  const std::vector<std::int64_t> joints = add_joints(asset.skeleton, root, scene);
  if (!asset.mesh.vertices.empty()) {
    const std::string mesh_name = unused_name(name + "_mesh", names);
    const std::vector<int> used = used_materials(asset.mesh);
    const std::int64_t mesh = add_model(mesh_name, "Mesh", {}, root, scene);
    const std::int64_t geometry = add_geometry(asset.mesh, mesh_name, used, scene);
    scene.connect(geometry, mesh);
    Materials materials(asset, file, scene);
    for (const int material : used) materials.add(material, mesh);
    if (!joints.empty()) {
      add_skin(asset, mesh_name, joints, geometry, scene);
      std::vector<std::pair<std::int64_t, Matrix4d>> nodes{{root, Matrix4d::Identity()}, {mesh, Matrix4d::Identity()}};
      for (std::size_t j = 0; j < joints.size(); ++j) nodes.emplace_back(joints[j], asset.skeleton.bind[j]);
      add_bind_pose(name, nodes, scene);
    }
  }
  add_clips(asset, joints, scene);
  const std::vector<std::string> clips = clip_names(asset);
  std::list<Record> records;
  add_header(records);
  add_settings(asset, records);
  add_documents(clips, records);
  add_definitions(scene, records);
  records.push_back(std::move(scene.objects));
  records.push_back(std::move(scene.connections));
  add_takes(asset, clips, records);
  return records;
}

}  // namespace

}  // namespace anigen::io::fbx_export

namespace anigen::io {

void write_fbx(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options) {
  const std::string file = path.string();
  Asset turned = file_asset(file, asset, options);
  remove_bind_scales(turned);
  fbx_export::refuse_zero_bytes(turned, file);
  write_file_atomically(path, fbx_export::file_bytes(fbx_export::records_of(turned, file), file));
}

}  // namespace anigen::io
