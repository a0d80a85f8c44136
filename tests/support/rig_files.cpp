#include "tests/support/rig_files.h"

#include <cstring>
#include <sstream>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::test {
namespace {

namespace fs = std::filesystem;

template <typename T>
std::string bytes_of(const std::vector<T>& values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  if (!values.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

void add_doubles(PickleBuilder& pickle, const std::vector<double>& values, const std::vector<int>& shape) {
  pickle.begin_array(shape).dtype("f8").boolean(false).data(bytes_of(values)).end_array();
}

void add_integers(PickleBuilder& pickle, const std::vector<std::int64_t>& values, const std::vector<int>& shape) {
  pickle.begin_array(shape).dtype("i8").boolean(false).data(bytes_of(values)).end_array();
}

std::vector<std::int64_t> wide(const std::vector<int>& values) { return {values.begin(), values.end()}; }

struct Coordinates {
  std::vector<std::int64_t> rows, columns;
  std::vector<double> values;
};

Coordinates coordinates(const RigFile& rig, bool halve) {
  Coordinates found;
  for (std::size_t i = 0; i < rig.skin.size(); ++i) {
    if (rig.skin[i] == 0.0f) continue;
    for (int part = 0; part < (halve ? 2 : 1); ++part) {
      found.rows.push_back(static_cast<std::int64_t>(i) / rig.skin_columns);
      found.columns.push_back(static_cast<std::int64_t>(i) % rig.skin_columns);
      found.values.push_back(halve ? rig.skin[i] / 2.0 : rig.skin[i]);
    }
  }
  return found;
}

void add_xl_sample(PickleBuilder& pickle, const RigFile& rig, const XlOptions& options) {
  std::vector<std::int64_t> bones;
  for (std::size_t j = 0; j < rig.parents.size(); ++j) {
    if (rig.parents[j] < 0) continue;
    bones.push_back(rig.parents[j]);
    bones.push_back(static_cast<std::int64_t>(j));
  }
  pickle.op("}").mark();
  pickle.text("vertices");
  add_doubles(pickle, {rig.vertices.begin(), rig.vertices.end()}, {rig.vertex_count(), 3});
  pickle.text("faces");
  add_integers(pickle, wide(rig.faces), {static_cast<int>(rig.faces.size() / 3), 3});
  pickle.text("pc_w_norm").begin_array({2}).dtype("f2").boolean(false).data(raw("\0\x3c\0\xc0")).end_array();
  pickle.text("uuid").text(rig.uuid);
  if (rig.has_skeleton) {
    pickle.text("joints");
    add_doubles(pickle, rig.joints, {rig.joint_count(), 3});
    pickle.text("bones");
    add_integers(pickle, bones, {static_cast<int>(bones.size() / 2), 2});
    pickle.text("root_index").integer(0).text("joint_names").op("]").mark();
    for (int j = 0; j < rig.joint_count(); ++j) pickle.text("j" + std::to_string(j));
    pickle.op("e");
  }
  if (rig.has_skin) {
    const Coordinates skin = coordinates(rig, options.halve_entries);
    const std::vector<int> shape = {static_cast<int>(skin.values.size())};
    pickle.text("skinning_weights_value");
    add_doubles(pickle, skin.values, shape);
    pickle.text("skinning_weights_row" + options.row_suffix);
    add_integers(pickle, skin.rows, shape);
    pickle.text("skinning_weights_col" + options.row_suffix);
    add_integers(pickle, skin.columns, shape);
    pickle.text("skinning_weights_shape").mark().integer(rig.skin_rows).integer(rig.skin_columns).tuple();
  }
  pickle.op("u");
}

/// Tensors of a torch archive, one storage each.
class TorchPickle {
 public:
  template <typename T>
  void tensor(const std::string& key, const std::string& storage, const std::vector<T>& values,
              const std::vector<int>& shape) {
    const std::string name = std::to_string(storages.size());
    pickle.text(key).global("torch._utils", "_rebuild_tensor_v2").mark().mark();
    pickle.text("storage").global("torch", storage).text(name).text("cpu");
    pickle.integer(static_cast<std::int32_t>(values.size())).tuple().op("Q").integer(0).mark();
    for (const int size : shape) pickle.integer(size);
    pickle.tuple().mark();
    for (std::size_t i = 0; i < shape.size(); ++i) {
      int stride = 1;
      for (std::size_t k = i + 1; k < shape.size(); ++k) stride *= shape[k];
      pickle.integer(stride);
    }
    pickle.tuple().boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
    storages.push_back({"archive/data/" + name, bytes_of(values)});
  }

  PickleBuilder pickle;
  std::vector<io::ZipContent> storages;
};

void add_anymate_sample(TorchPickle& out, const RigFile& rig, bool whole_mesh) {
  std::vector<std::int8_t> parents;
  std::vector<float> bones;
  for (std::size_t j = 0; j < rig.parents.size(); ++j) {
    parents.push_back(static_cast<std::int8_t>(rig.parents[j] < 0 ? static_cast<int>(j) : rig.parents[j]));
    for (const std::size_t end : {static_cast<std::size_t>(rig.parents[j]), j}) {
      for (std::size_t k = 0; rig.parents[j] >= 0 && k < 3; ++k)
        bones.push_back(static_cast<float>(rig.joints[3 * end + k]));
    }
  }
  std::vector<float> points;
  for (std::size_t i = 0; i < rig.vertices.size(); ++i) {
    points.push_back(rig.vertices[i]);
    if (i % 3 == 2) points.insert(points.end(), {0, 0, 2});
  }
  // Every bone's weight in a column, padded as the collator expects it.
  std::vector<std::int32_t> index;
  for (std::size_t i = 0; i < rig.skin.size(); ++i)
    index.push_back(rig.skin[i] == 0.0f ? -1 : static_cast<std::int32_t>(i) % rig.skin_columns);
  const int vertices = rig.vertex_count(), joints = rig.joint_count();
  out.pickle.op("}").mark().text("name").text(rig.uuid);
  out.tensor(whole_mesh ? "mesh_pc" : "pc", "FloatStorage", points, {vertices, 6});
  if (whole_mesh) out.tensor("mesh_face", "IntStorage", rig.faces, {static_cast<int>(rig.faces.size() / 3), 3});
  if (rig.has_skeleton) {
    out.tensor("joints", "FloatStorage", std::vector<float>(rig.joints.begin(), rig.joints.end()), {joints, 3});
    out.pickle.text("joints_num").integer(joints);
    out.tensor("conns", "CharStorage", parents, {joints});
    out.tensor("bones", "FloatStorage", bones, {static_cast<int>(bones.size() / 6), 6});
  }
  if (rig.has_skin) {
    const std::string name = whole_mesh ? "mesh_skins" : "skins";
    out.tensor(name + "_index", "IntStorage", index, {rig.skin_rows, rig.skin_columns});
    out.tensor(name + "_weight", "FloatStorage", rig.skin, {rig.skin_rows, rig.skin_columns});
  }
  out.pickle.op("u");
}  // namespace anigen::test

}  // namespace

RigFile::RigFile()
    : vertices{-0.1f, 0, 0, 0.1f, 0, 0, -0.1f, 0, 0.5f, 0.1f, 0, 0.5f, -0.1f, 0, 1, 0.1f, 0, 1},
      faces{0, 1, 3, 0, 3, 2, 2, 3, 5, 2, 5, 4},
      joints{0, 0, 0, 0, 0, 0.5, 0, 0, 1},
      parents{-1, 0, 1},
      skin{1, 0, 0, 1, 0, 0, 0.25f, 0.75f, 0, 0.5f, 0.5f, 0, 0, 0, 1, 0, 0, 1},
      skin_rows(6),
      skin_columns(3) {}

void RigFile::keep_joints(int count) {
  std::vector<float> kept;
  for (std::size_t i = 0; i < skin.size(); ++i) {
    if (static_cast<int>(i) % skin_columns < count) kept.push_back(skin[i]);
  }
  skin = kept;
  skin_columns = count;
  joints.resize(static_cast<std::size_t>(3 * count));
  parents.resize(static_cast<std::size_t>(count));
}

void write_rig_npz(const fs::path& path, const RigFile& rig) {
  using io::NdArray;
  const std::int64_t faces = static_cast<std::int64_t>(rig.faces.size() / 3);
  io::NamedArrays arrays = {{"vertices", NdArray::from(rig.vertices, {rig.vertex_count(), 3})},
                            {"faces", NdArray::from(wide(rig.faces), {faces, 3})}};
  if (rig.has_skeleton) {
    arrays.emplace_back("joints", NdArray::from(rig.joints, {rig.joint_count(), 3}));
    arrays.emplace_back("parents", NdArray::from(wide(rig.parents), {rig.joint_count()}));
  }
  if (rig.has_skin) arrays.emplace_back("skin", NdArray::from(rig.skin, {rig.skin_rows, rig.skin_columns}));
  io::write_npz(path, arrays);
}

void write_articulation_xl(const fs::path& path, const std::vector<RigFile>& rigs, const XlOptions& options) {
  const auto count = static_cast<int>(rigs.size());
  PickleBuilder pickle(3);
  pickle.begin_array({count}).dtype("O8", "|").boolean(false).op("]").mark();
  for (const RigFile& rig : rigs) add_xl_sample(pickle, rig, options);
  pickle.op("e").end_array();
  std::vector<std::pair<std::string, std::string>> members;
  if (options.stray_member)
    members.emplace_back("allow_pickle.npy", npy("{'descr': '|b1', 'fortran_order': False, 'shape': (), }", raw("\1")));
  const std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': (" + std::to_string(count) + ",), }";
  members.emplace_back("arr_0.npy", npy(header, pickle.stop()));
  fs::create_directories(path.parent_path());
  write_quickly(path, stored_zip(members));
}

std::string text_rig(const RigFile& rig) {
  std::ostringstream text;
  for (int j = 0; rig.has_skeleton && j < rig.joint_count(); ++j) {
    text << "joints j" << j;
    for (std::size_t k = 0; k < 3; ++k) text << ' ' << rig.joints[3 * static_cast<std::size_t>(j) + k];
    text << '\n';
  }
  text << "root j0\n";
  for (std::size_t v = 0; rig.has_skin && v < static_cast<std::size_t>(rig.skin_rows); ++v) {
    text << "skin " << v;
    for (int j = 0; j < rig.skin_columns; ++j) {
      const float weight = rig.skin[v * static_cast<std::size_t>(rig.skin_columns) + static_cast<std::size_t>(j)];
      if (weight != 0.0f) text << " j" << j << ' ' << weight;
    }
    text << '\n';
  }
  for (std::size_t j = 0; j < rig.parents.size(); ++j) {
    if (rig.parents[j] >= 0) text << "hier j" << rig.parents[j] << " j" << j << '\n';
  }
  return text.str();
}

std::string obj_text(const RigFile& rig) {
  std::ostringstream text;
  for (std::size_t i = 0; i < rig.vertices.size(); i += 3)
    text << "v " << rig.vertices[i] << ' ' << rig.vertices[i + 1] << ' ' << rig.vertices[i + 2] << '\n';
  for (std::size_t i = 0; i < rig.faces.size(); i += 3)
    text << "f " << rig.faces[i] + 1 << ' ' << rig.faces[i + 1] + 1 << ' ' << rig.faces[i + 2] + 1 << '\n';
  return text.str();
}

void write_text_rig(const fs::path& path, const RigFile& rig) {
  fs::create_directories(path.parent_path());
  write_quickly(path, text_rig(rig));
  write_quickly(fs::path(path).replace_extension(".obj"), obj_text(rig));
}

void write_anymate(const fs::path& path, const std::vector<RigFile>& rigs, bool whole_mesh) {
  TorchPickle out;
  out.pickle.op("]").mark();
  for (const RigFile& rig : rigs) add_anymate_sample(out, rig, whole_mesh);
  out.pickle.op("e");
  std::vector<io::ZipContent> members = {{"archive/data.pkl", out.pickle.stop()}};
  members.insert(members.end(), out.storages.begin(), out.storages.end());
  io::write_zip(path, members);
}

RigFile per_bone(RigFile rig) {
  const auto columns = static_cast<std::size_t>(rig.skin_columns);
  for (std::size_t last = columns - 1; last < rig.skin.size(); last += columns) {
    rig.skin[last - 1] += rig.skin[last];
    rig.skin[last] = 0;
  }
  return rig;
}

void write_glb(const fs::path& path, const RigFile& rig) {
  Asset asset;
  for (std::size_t i = 0; i < rig.vertices.size(); i += 3)
    asset.mesh.vertices.emplace_back(rig.vertices[i], rig.vertices[i + 1], rig.vertices[i + 2]);
  for (std::size_t i = 0; i < rig.faces.size(); i += 3)
    asset.mesh.faces.push_back({rig.faces[i], rig.faces[i + 1], rig.faces[i + 2]});
  std::vector<Eigen::Vector3d> joints;
  for (std::size_t i = 0; i < rig.joints.size(); i += 3)
    joints.emplace_back(rig.joints[i], rig.joints[i + 1], rig.joints[i + 2]);
  asset.skeleton = skeleton_from_joints(joints, rig.parents);
  asset.skin = from_dense(rig.skin, static_cast<std::size_t>(rig.skin_rows), joints.size());
  io::write_gltf(path, asset);
}

std::string refusal(const std::function<void()>& action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.place() + (error.place().empty() ? "" : ": ") + error.problem();
  }
  return "";
}

}  // namespace anigen::test
