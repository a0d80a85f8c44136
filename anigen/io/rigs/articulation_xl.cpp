#include "anigen/io/rigs/articulation_xl.h"

#include <unistd.h>

#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::io {
namespace {

constexpr double kReadingFactor = 3.0;  // the pickle, its arrays, and the tree made of them

std::size_t kept_bytes(const RiggedShape& shape) {
  const Mesh& mesh = shape.mesh;
  return sizeof(RiggedShape) + mesh.vertices.capacity() * sizeof(mesh.vertices[0]) +
         mesh.faces.capacity() * sizeof(Triangle) + mesh.normals.capacity() * sizeof(mesh.normals[0]) +
         shape.joints.size() * (sizeof(Eigen::Vector3d) + sizeof(int) + sizeof(std::string)) +
         shape.skin.offsets.capacity() * sizeof(std::size_t) + shape.skin.influences.capacity() * sizeof(Influence);
}

bool holds_samples(const NpzValue& value) {
  using Kind = NpzValue::Kind;
  return value.kind == Kind::kList && !value.items.empty() && value.items.front().kind == Kind::kDict;
}

constexpr double kGibibyte = 1024.0 * 1024.0 * 1024.0;

/// Refused before it is tried: the system would rather end the program than the allocation.
void require_memory(const ZipReader& archive, const ZipMember& member) {
  const double needed = kReadingFactor * static_cast<double>(member.bytes);
  const double there = static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (needed <= there) return;
  const auto gibibytes = [](double bytes) { return std::to_string(static_cast<long>(bytes / kGibibyte)) + " GiB"; };
  throw InputError(archive.file(), member.name,
                   "reading it takes about " + gibibytes(needed) + " of memory and this machine has " +
                       gibibytes(there) + "; split the file");
}

/// Members one after the other, so that strays behind the list are not read.
NpzValue sample_list(const std::filesystem::path& file) {
  std::vector<std::string> names;
  {
    const ZipReader archive(file);
    for (const ZipMember& member : archive.members()) {
      const std::size_t end = member.name.rfind(".npy");
      if (end != std::string::npos && end + 4 == member.name.size()) {
        require_memory(archive, member);
        names.push_back(member.name.substr(0, end));
      }
    }
  }
  for (const std::string& name : names) {
    if (name == "allow_pickle") continue;
    NpzValue value = std::move(read_npz_objects(file, {name}).front().second);
    if (holds_samples(value)) return value;
  }
  throw InputError(file.string(), "", "holds neither the arrays joints and vertices nor a list of sample dictionaries");
}

}  // namespace

ArticulationXlSource::ArticulationXlSource(const std::filesystem::path& file, const SourceOptions& options)
    : file_(file.string()) {
  NpzValue samples = sample_list(file);
  for (std::size_t i = 0; i < samples.items.size(); ++i) add(std::move(samples.items[i]), i, options);
}

void ArticulationXlSource::add(NpzValue sample, std::size_t index, const SourceOptions& options) {
  const std::string place = "sample " + std::to_string(index);
  const NpzValue* uuid = sample.find("uuid");
  if (uuid == nullptr || uuid->kind != NpzValue::Kind::kString || uuid->text.empty())
    throw InputError(file_, place, "has no uuid");
  const std::string id = uuid->text;
  const auto [there, is_new] = samples_.try_emplace(id);
  if (!is_new) throw InputError(file_, place, "the uuid " + id + " appears twice");
  ids_.push_back(id);
  Sample& kept = there->second;
  try {
    kept.shape = shape_from_articulation_xl(sample, id, file_, options.content_ids ? &kept.content_id : nullptr);
    turn_to_z_up(kept.shape, options.axes, Axes::kZUp);
    kept.sound = true;
    bytes_ += kept_bytes(kept.shape);
  } catch (const InputError& error) {
    kept.place = "sample " + id + (error.place().empty() ? "" : ", " + error.place());
    kept.problem = error.problem();
  }
}

const ArticulationXlSource::Sample& ArticulationXlSource::sample(const std::string& id) const {
  const auto found = samples_.find(id);
  if (found == samples_.end()) throw InputError(file_, "", "has no sample \"" + id + "\"");
  return found->second;
}

RiggedShape ArticulationXlSource::read(const std::string& id) const {
  const Sample& kept = sample(id);
  if (!kept.sound) throw InputError(file_, kept.place, kept.problem);
  return kept.shape;
}

std::string ArticulationXlSource::sample_id(const std::string& id) const { return sample(id).content_id; }

std::string ArticulationXlSource::describe() const {
  constexpr std::size_t kMebibyte = std::size_t{1} << 20;
  return "Articulation-XL file " + file_ + ": " + std::to_string(ids_.size()) + " samples, " +
         std::to_string((bytes_ + kMebibyte - 1) / kMebibyte) + " MiB in memory";
}

}  // namespace anigen::io
