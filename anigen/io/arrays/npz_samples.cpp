#include "anigen/io/arrays/npz_samples.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npz_objects.h"

namespace anigen::io {

/// The pickle behind the header of a member.
struct NpzSamples::Bytes : pickle::ByteSource {
  Bytes(const ZipReader& archive, const ZipMember& zipped, std::uint64_t begin)
      : member(archive, zipped), data(begin) {}

  std::uint64_t size() const override { return member.size() - data; }
  void read(std::uint64_t offset, char* to, std::size_t bytes) const override { member.read(data + offset, to, bytes); }
  pickle::Source source() const { return {member.file(), member.name(), data, false}; }

  SeekableMember member;
  std::uint64_t data;
};

NpzSamples::NpzSamples(std::unique_ptr<const Bytes> bytes, std::unique_ptr<const pickle::Outline> outline)
    : bytes_(std::move(bytes)), outline_(std::move(outline)) {}

NpzSamples::~NpzSamples() = default;

std::unique_ptr<const NpzSamples> NpzSamples::open(const std::filesystem::path& file, const std::string& name_key) {
  const ZipReader archive(file);
  for (const ZipMember& member : archive.members()) {
    const std::string suffix = ".npy";
    const std::size_t end = member.name.rfind(suffix);
    if (end == std::string::npos || end + suffix.size() != member.name.size() || member.name == "allow_pickle.npy")
      continue;
    const NpyMemberHeader npy = read_npy_header(archive, member);
    if (npy.header.element.kind != NpyElement::Kind::kObject) continue;
    auto bytes = std::make_unique<const Bytes>(archive, member, npy.data);
    std::unique_ptr<const pickle::Outline> outline = pickle::Outline::read(*bytes, bytes->source(), name_key);
    if (!outline) return nullptr;  // the whole decides whether a later member is the list
    if (outline->sizes() != npy.header.shape)
      throw InputError(archive.file(), member.name, "its pickle is not the object array that its header announces");
    return std::unique_ptr<const NpzSamples>(new NpzSamples(std::move(bytes), std::move(outline)));
  }
  return nullptr;
}

NpzValue NpzSamples::read(std::size_t index) const {
  const pickle::Document document = outline_->load(*bytes_, bytes_->source(), index);
  const NpyPlace place{bytes_->member.file(), bytes_->member.name()};
  return object_tree(document.root(), outline_->dicts().at(index).bytes, place);
}

}  // namespace anigen::io
