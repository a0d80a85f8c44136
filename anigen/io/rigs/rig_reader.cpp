#include "anigen/io/rigs/rig_reader.h"

#include <utility>

#include "anigen/asset/validate.h"
#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/io/npz.h"
#include "anigen/io/rigs/anymate_archive.h"
#include "anigen/io/rigs/articulation_xl.h"
#include "anigen/io/rigs/assimp_scene.h"
#include "anigen/io/rigs/content_id.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rig_arrays.h"
#include "anigen/io/rigs/text_rig.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

fs::path dataset_file(const RigEntry& entry) { return entry.file / "skeleton" / entry.key / "skeleton_voxelized.npz"; }

std::size_t repeated_names(const std::vector<std::string>& names) {
  const std::set<std::string> different(names.begin(), names.end());
  return names.size() - different.size();
}

/// Parts that an asset cannot be without, and the repairs as notes of the importers.
ImportedAsset asset_of(RiggedShape shape) {
  const auto refuse = [&shape](const std::string& problem) {
    throw InputError(shape.file, shape.id.empty() ? "" : "sample " + shape.id, problem);
  };
  if (!shape.has_surface()) refuse("has no mesh with faces");
  if (!shape.has_joints()) refuse("has no skeleton");
  if (!shape.has_skin()) refuse("has no skin weights");
  ImportedAsset imported;
  imported.lowest_weight_sum = shape.lowest_weight_sum;
  const auto tally = [&imported](const std::string& code, std::size_t count, const std::string& what) {
    if (count > 0) imported.notes.push_back({code, std::to_string(count) + " " + what});
  };
  tally("zero_weights", shape.unweighted, "vertices had no weight and were bound to the root");
  tally("duplicate_joint_names", repeated_names(shape.joint_names), "joints had the name of an earlier one");
  const std::size_t trees = roots(shape.joints).size();
  if (trees > 1) tally("several_roots", trees, "joint roots: all but the first became its children");
  imported.asset = to_asset(shape);
  imported.asset.name = shape.id;
  const std::vector<std::string> findings = validate(imported.asset, 1);
  if (!findings.empty()) refuse("cannot be made a sound asset: " + findings.front());
  return imported;
}

NamedArrays plain_arrays(const fs::path& file) {
  require_content(file);
  NamedArrays arrays;
  for (const auto& [name, header] : read_npz_headers(file)) {
    for (const char* wanted : {"joints", "parents", "skin", "vertices", "faces", "vertex_normals"}) {
      if (name == wanted) arrays.push_back(std::move(read_npz(file, {name}).front()));
    }
  }
  return arrays;
}

}  // namespace

std::shared_ptr<const ShapeSource> RigReader::shard(const RigEntry& entry) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (open_shard_ == nullptr || open_file_ != entry.file) {
    open_shard_.reset();  // before another one is read: two may not fit in memory
    SourceOptions options;
    options.content_ids = true;
    require_content(entry.file);
    if (entry.format == RigFormat::kAnymate)
      open_shard_ = std::make_shared<AnymateSource>(std::vector<fs::path>{entry.file}, options, false);
    else
      open_shard_ = std::make_shared<ArticulationXlSource>(entry.file, options);
    open_file_ = entry.file;
  }
  return open_shard_;
}

ImportedAsset RigReader::read(const RigEntry& entry) const {
  switch (entry.format) {
    case RigFormat::kGltf:
      require_content(entry.file);
      return read_gltf(entry.file);
    case RigFormat::kAssimp:
      require_content(entry.file);
      return read_assimp(entry.file);
    case RigFormat::kTextRig:
      require_content(entry.file);
      return asset_of(read_text_rig(entry.file, entry.file.stem().string()));
    case RigFormat::kRigArrays:
      require_content(entry.file);
      return asset_of(read_rig_npz(entry.file, entry.file.stem().string()));
    case RigFormat::kDataset:
      require_content(dataset_file(entry));
      return asset_of(read_rig_npz(dataset_file(entry), entry.key));
    case RigFormat::kArticulationXl:
    case RigFormat::kAnymate:
      break;
  }
  return asset_of(shard(entry)->read(entry.key));
}

std::string RigReader::content_id(const RigEntry& entry) const {
  const ImportOptions limits;
  switch (entry.format) {
    case RigFormat::kGltf:
      if (lower_extension(entry.file) == ".gltf") return gltf_content_id(entry.file);
      return sha256(read_file(entry.file, limits.max_file_bytes));
    case RigFormat::kAssimp:
      return sha256(read_file(entry.file, limits.max_file_bytes));
    case RigFormat::kTextRig: {
      Sha256 digest;
      digest.update(read_file(entry.file, limits.max_file_bytes));
      const fs::path mesh = mesh_of_text_rig(entry.file);
      if (!mesh.empty()) digest.update(read_file(mesh, limits.max_file_bytes));
      return digest.finish();
    }
    case RigFormat::kRigArrays:
      return io::content_id(plain_arrays(entry.file));
    case RigFormat::kDataset:
      return io::content_id(plain_arrays(dataset_file(entry)));
    case RigFormat::kArticulationXl:
    case RigFormat::kAnymate:
      break;
  }
  return shard(entry)->sample_id(entry.key);
}

}  // namespace anigen::io
