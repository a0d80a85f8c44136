#include "anigen/eval/inputs/articulation_xl.h"

#include <unistd.h>

#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::eval {
namespace {

constexpr double kReadingFactor = 3.0;  // the pickle, its arrays, and the tree made of them

std::size_t kept_bytes(const RiggedShape& shape) {
  const Mesh& mesh = shape.mesh;
  return sizeof(RiggedShape) + mesh.vertices.capacity() * sizeof(mesh.vertices[0]) +
         mesh.faces.capacity() * sizeof(Triangle) + mesh.normals.capacity() * sizeof(mesh.normals[0]) +
         shape.joints.size() * (sizeof(Eigen::Vector3d) + sizeof(int) + sizeof(std::string)) +
         shape.skin.offsets.capacity() * sizeof(std::size_t) + shape.skin.influences.capacity() * sizeof(Influence);
}

bool holds_samples(const io::NpzValue& value) {
  using Kind = io::NpzValue::Kind;
  return value.kind == Kind::kList && !value.items.empty() && value.items.front().kind == Kind::kDict;
}

constexpr double kGibibyte = 1024.0 * 1024.0 * 1024.0;

/// Refused before it is tried: the system would rather end the program than the allocation.
void require_memory(const io::ZipReader& archive, const io::ZipMember& member) {
  const double needed = kReadingFactor * static_cast<double>(member.bytes);
  const double there = static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (needed <= there) return;
  const auto gibibytes = [](double bytes) { return std::to_string(static_cast<long>(bytes / kGibibyte)) + " GiB"; };
  throw InputError(archive.file(), member.name,
                   "reading it takes about " + gibibytes(needed) + " of memory and this machine has " +
                       gibibytes(there) + "; split the file");
}

/// Members one after the other, so that strays behind the list are not read.
io::NpzValue sample_list(const std::filesystem::path& file) {
  std::vector<std::string> names;
  {
    const io::ZipReader archive(file);
    for (const io::ZipMember& member : archive.members()) {
      const std::size_t end = member.name.rfind(".npy");
      if (end != std::string::npos && end + 4 == member.name.size()) {
        require_memory(archive, member);
        names.push_back(member.name.substr(0, end));
      }
    }
  }
  for (const std::string& name : names) {
    if (name == "allow_pickle") continue;
    io::NpzValue value = std::move(io::read_npz_objects(file, {name}).front().second);
    if (holds_samples(value)) return value;
  }
  throw InputError(file.string(), "", "holds neither the arrays joints and vertices nor a list of sample dictionaries");
}

}  // namespace

ArticulationXlSource::ArticulationXlSource(const std::filesystem::path& file, const SourceOptions& options)
    : file_(file.string()) {
  io::NpzValue samples = sample_list(file);
  for (std::size_t i = 0; i < samples.items.size(); ++i) add(std::move(samples.items[i]), i, options.axes);
}

void ArticulationXlSource::add(io::NpzValue sample, std::size_t index, Axes axes) {
  const std::string place = "sample " + std::to_string(index);
  const io::NpzValue* uuid = sample.find("uuid");
  if (uuid == nullptr || uuid->kind != io::NpzValue::Kind::kString || uuid->text.empty())
    throw InputError(file_, place, "has no uuid");
  const std::string id = uuid->text;
  const auto [there, is_new] = samples_.try_emplace(id);
  if (!is_new) throw InputError(file_, place, "the uuid " + id + " appears twice");
  ids_.push_back(id);
  Sample& kept = there->second;
  try {
    kept.shape = shape_from_articulation_xl(sample, id, file_);
    turn_to_z_up(kept.shape, axes, Axes::kZUp);
    kept.sound = true;
    bytes_ += kept_bytes(kept.shape);
  } catch (const InputError& error) {
    kept.place = "sample " + id + (error.place().empty() ? "" : ", " + error.place());
    kept.problem = error.problem();
  }
}

RiggedShape ArticulationXlSource::read(const std::string& id) const {
  const auto found = samples_.find(id);
  if (found == samples_.end()) throw InputError(file_, "", "has no sample \"" + id + "\"");
  if (!found->second.sound) throw InputError(file_, found->second.place, found->second.problem);
  return found->second.shape;
}

std::string ArticulationXlSource::describe() const {
  constexpr std::size_t kMebibyte = std::size_t{1} << 20;
  return "Articulation-XL file " + file_ + ": " + std::to_string(ids_.size()) + " samples, " +
         std::to_string((bytes_ + kMebibyte - 1) / kMebibyte) + " MiB in memory";
}

}  // namespace anigen::eval
