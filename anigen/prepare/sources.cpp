#include "anigen/prepare/sources.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/random.h"
#include "anigen/geometry/inside.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::prepare {

namespace {

namespace fs = std::filesystem;

/// Raised whenever make_creature() gives another asset for the same numbers, so that old entries are not mistaken
/// for new ones.
constexpr int kCreatureRecipeVersion = 1;

template <typename T>
T member(const Json& json, const char* key) {
  try {
    return json.at(key).get<T>();
  } catch (const Json::exception&) {
    throw InputError("", std::string("/") + key, "is missing or of another type");
  }
}

std::vector<AssetSource> creatures_of(std::uint64_t seed, std::uint64_t first, std::size_t count) {
  std::vector<AssetSource> sources(count);
  for (std::size_t i = 0; i < count; ++i) {
    sources[i].seed = seed;
    sources[i].index = first + i;
    sources[i].file_identifier = "procedural/" + std::to_string(seed) + "/" + std::to_string(first + i);
  }
  return sources;
}

}  // namespace

std::string AssetSource::source_path() const {
  const std::string key = io::key_of_sample(local_path);
  return key.empty() ? local_path : local_path.substr(0, local_path.size() - key.size() - 1);
}

void to_json(Json& json, const AssetSource& source) {
  if (source.procedural()) {
    json["format"] = "procedural";
    json["seed"] = source.seed;
    json["index"] = source.index;
  } else {
    json["format"] = io::name_of(source.format);
    json["file"] = source.file.string();
    json["key"] = source.key;
    json["local_path"] = source.local_path;
    json["is_test"] = source.is_test;
    json["uuid"] = source.uuid;
    if (!source.variant_of.empty()) json["variant_of"] = source.variant_of;
  }
  json["file_identifier"] = source.file_identifier;
}

void from_json(const Json& json, AssetSource& source) {
  const auto format = member<std::string>(json, "format");
  source.file_identifier = member<std::string>(json, "file_identifier");
  if (format == "procedural") {
    source.seed = member<std::uint64_t>(json, "seed");
    source.index = member<std::uint64_t>(json, "index");
    return;
  }
  source.format = io::parse_rig_format(format);
  source.file = member<std::string>(json, "file");
  if (source.file.empty()) throw InputError("", "/file", "is empty");
  source.key = member<std::string>(json, "key");
  source.local_path = member<std::string>(json, "local_path");
  source.is_test = member<bool>(json, "is_test");
  source.uuid = json.value("uuid", "");
  source.variant_of = json.value("variant_of", "");
}

std::vector<AssetSource> find_assets(const std::vector<fs::path>& inputs) {
  std::vector<AssetSource> sources;
  for (const fs::path& given : inputs) {
    std::error_code error;
    // "folder/" has an empty file name; its own name is wanted for file_identifier.
    const fs::path input = given.has_filename() ? given : given.parent_path();
    const std::vector<io::RigEntry> entries = io::list_rigs(input);
    const fs::path named = fs::is_directory(input, error) ? input : fs::absolute(input).parent_path();
    const std::string name = fs::weakly_canonical(named, error).filename().string();
    for (const io::RigEntry& entry : entries) {
      sources.push_back({entry.format, entry.file, entry.key, entry.local_path, name + "/" + entry.local_path,
                         entry.is_test, entry.uuid});
      sources.back().variant_of = entry.variant_of;
    }
  }
  return sources;
}

std::vector<AssetSource> procedural_sources(std::uint64_t seed, std::size_t count) {
  return creatures_of(seed, 0, count);
}

std::vector<AssetSource> stream_sources(std::uint64_t seed, std::uint64_t shard, std::size_t count) {
  if (seed >= creature_seeds::kFirstOfStreams) {
    throw InputError("", "--seed",
                     "must be below " + std::to_string(creature_seeds::kFirstOfStreams) + " for a stream");
  }
  return creatures_of(creature_seeds::kFirstOfStreams + seed, shard * count, count);
}

std::string asset_id(const AssetSource& source, const io::RigReader& reader) {
  if (source.procedural()) return sha256(source.file_identifier + "/" + std::to_string(kCreatureRecipeVersion));
  if (source.format == io::RigFormat::kDataset) return source.key;
  return reader.content_id(source.rig());
}

void write_skeleton_archive(const std::filesystem::path& path, const Asset& asset) {
  const std::size_t joints = asset.skeleton.size(), vertices = asset.mesh.vertices.size();
  if (joints > 0 && vertices > kMaxDenseSkinBytes / sizeof(float) / joints) {
    throw InputError(asset.name, "",
                     "dense weights of " + std::to_string(vertices) + " vertices by " + std::to_string(joints) +
                         " joints exceed " + std::to_string(kMaxDenseSkinBytes >> 20) + " MiB");
  }
  std::vector<float> positions, points;
  for (const Eigen::Vector3d& p : asset.skeleton.positions()) {
    for (int k = 0; k < 3; ++k) positions.push_back(static_cast<float>(p[k]));
  }
  for (const Eigen::Vector3f& p : asset.mesh.vertices) points.insert(points.end(), p.data(), p.data() + 3);
  std::vector<std::int32_t> faces;
  for (const Triangle& face : asset.mesh.faces) faces.insert(faces.end(), face.begin(), face.end());
  const std::vector<std::int32_t> parents(asset.skeleton.parents.begin(), asset.skeleton.parents.end());
  const auto n = [](std::size_t size) { return static_cast<std::int64_t>(size); };
  io::write_npz(path, {{"joints", io::NdArray::from(positions, {n(joints), 3})},
                       {"parents", io::NdArray::from(parents, {n(joints)})},
                       {"skin", io::NdArray::from(to_dense(asset.skin, joints), {n(vertices), n(joints)})},
                       {"vertices", io::NdArray::from(points, {n(vertices), 3})},
                       {"faces", io::NdArray::from(faces, {n(asset.mesh.faces.size()), 3})}});
}

double closest_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents) {
  std::vector<Eigen::Vector3d> bones;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (parents[j] < 0) continue;
    bones.push_back((joints[j] - joints[static_cast<std::size_t>(parents[j])]).cast<double>());
  }
  // Sorted by x, a pair closer than the best one so far lies within a window of that width.
  std::sort(bones.begin(), bones.end(), [](const auto& a, const auto& b) { return a.x() < b.x(); });
  double closest = kNoPair;
  for (std::size_t i = 0; i < bones.size(); ++i) {
    for (std::size_t k = i + 1; k < bones.size() && bones[k].x() - bones[i].x() < closest; ++k)
      closest = std::min(closest, (bones[k] - bones[i]).cwiseAbs().maxCoeff());
  }
  return closest;
}

namespace {

// Area vectors of a closed surface cancel; those of a sheet do not.
bool faces_one_way(const Mesh& mesh) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double areas = 0.0;
  for (const Triangle& face : mesh.faces) {
    const auto is_vertex = [&](std::int32_t i) { return i >= 0 && static_cast<std::size_t>(i) < mesh.vertices.size(); };
    if (!std::all_of(face.begin(), face.end(), is_vertex)) continue;
    const auto corner = [&](std::size_t k) {
      return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(face[k])].cast<double>());
    };
    const Eigen::Vector3d area = (corner(1) - corner(0)).cross(corner(2) - corner(0));
    sum += area;
    areas += area.norm();
  }
  return sum.norm() >= 0.5 * areas;
}

}  // namespace

double outside_share(const std::vector<Eigen::Vector3d>& joints, const Mesh& mesh) {
  if (joints.empty()) return 0.0;
  const Box box = bounding_box(mesh.vertices);
  const double margin = 1e-4 * box.diagonal();
  std::vector<bool> inside;
  if (faces_one_way(mesh)) {
    for (const Eigen::Vector3d& joint : joints)
      inside.push_back((joint.array() >= box.low.array() - margin).all() &&
                       (joint.array() <= box.high.array() + margin).all());
  } else {
    inside = geometry::InsideTest(mesh.vertices, mesh.faces).inside(joints, margin);
  }
  const auto outside = std::count(inside.begin(), inside.end(), false);
  return static_cast<double>(outside) / static_cast<double>(joints.size());
}

}  // namespace anigen::prepare
