#include "anigen/io/npz.h"

#include <algorithm>
#include <array>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz_objects.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::io {
namespace {

constexpr std::string_view kSuffix = ".npy";

bool is_array_member(const std::string& name) {
  return name.size() > kSuffix.size() && name.compare(name.size() - kSuffix.size(), kSuffix.size(), kSuffix) == 0;
}

std::string array_name(const ZipMember& member) { return member.name.substr(0, member.name.size() - kSuffix.size()); }

/// The arrays with these names, in the order of the names; all of them, in file order, when there are no names.
std::vector<ZipMember> select(const ZipReader& archive, const std::vector<std::string>& names) {
  std::vector<ZipMember> selected;
  if (names.empty()) {
    std::copy_if(archive.members().begin(), archive.members().end(), std::back_inserter(selected),
                 [](const ZipMember& member) { return is_array_member(member.name); });
    return selected;
  }
  for (const std::string& name : names) {
    const ZipMember* member = archive.find(name + std::string(kSuffix));
    if (!member) {
      std::string present;
      for (const ZipMember& there : select(archive, {})) present += (present.empty() ? "" : ", ") + array_name(there);
      throw InputError(archive.file(), "",
                       "has no array '" + name + "'; it holds: " + (present.empty() ? "nothing" : present));
    }
    selected.push_back(*member);
  }
  return selected;
}

/// One NPY member: the header is read at once, the data when asked for.
class NpyMember {
 public:
  NpyMember(const ZipReader& archive, const ZipMember& member)
      : place_{archive.file(), member.name}, member_(member), reader_(archive, member) {
    std::array<unsigned char, 12> start{};
    constexpr std::size_t kMagic = 6, kVersion = 2;
    need(kMagic + kVersion + 2);
    reader_.read(start.data(), kMagic + kVersion);
    if (std::string_view(reinterpret_cast<const char*>(start.data()), kMagic) != "\x93NUMPY") {
      throw InputError(place_.file, place_.member + ", byte 0", "not an NPY array");
    }
    const int major = start[6];
    if (major < 1 || major > 3)
      throw NotSupportedError(place_.file, place_.member, "NPY version " + std::to_string(major));
    const std::size_t length_bytes = major == 1 ? 2 : 4;
    need(kMagic + kVersion + length_bytes);
    reader_.read(start.data(), length_bytes);
    std::size_t length = 0;
    for (std::size_t i = length_bytes; i-- > 0;) length = length << 8 | start[i];
    constexpr std::size_t kMaxHeader = 1 << 20;
    if (length > kMaxHeader) throw InputError(place_.file, place_.member, "NPY header of implausible length");
    header_start_ = static_cast<std::size_t>(reader_.position());
    need(header_start_ + length);
    std::string text(length, '\0');
    reader_.read(text.data(), length);
    header_ = parse_npy_header(text, header_start_, place_);
    check_size();
  }

  const NpyHeader& header() const { return header_; }
  const NpyPlace& place() const { return place_; }
  bool numeric() const { return header_.element.kind == NpyElement::Kind::kNumber; }

  NdArray numbers() { return decode_npy(header_, rest<std::vector<std::uint8_t>>(), place_); }

  NpzValue value() {
    if (numeric()) {
      NpzValue value;
      value.kind = NpzValue::Kind::kArray;
      value.array = numbers();
      return value;
    }
    const auto start = static_cast<std::size_t>(reader_.position());
    if (header_.element.kind != NpyElement::Kind::kObject)
      return decode_text_array(header_, rest<std::string>(), place_);
    if (header_.fortran_order && header_.shape.size() > 1) {
      throw NotSupportedError(place_.file, place_.member, "object arrays in Fortran order");
    }
    return unpickle_object_array(rest<std::string>(), header_.shape, start, place_);
  }

 private:
  void need(std::uint64_t bytes) const {
    if (bytes > member_.bytes) {
      throw InputError(place_.file, place_.member + ", byte " + std::to_string(member_.bytes),
                       "ends inside the NPY header");
    }
  }

  /// Before anything is allocated for the data.
  void check_size() const {
    std::size_t count = 0;
    if (!count_elements(header_.shape, header_.element.size, count)) {
      throw InputError(place_.file, place_.member, "its shape overflows");
    }
    if (header_.element.kind == NpyElement::Kind::kObject) return;
    const std::uint64_t there = member_.bytes - reader_.position();
    if (count * header_.element.size != there) {
      throw InputError(place_.file, place_.member,
                       "its shape needs " + std::to_string(count * header_.element.size) + " bytes of data and " +
                           std::to_string(there) + " are there");
    }
  }

  template <typename Bytes>
  Bytes rest() {
    Bytes bytes;
    constexpr std::uint64_t kPiece = std::uint64_t{64} << 20;  // a false declared size costs no memory
    while (reader_.position() < member_.bytes) {
      const std::size_t start = bytes.size();
      const std::uint64_t piece = std::min(kPiece, member_.bytes - reader_.position());
      bytes.resize(start + piece);
      reader_.read(bytes.data() + start, piece);
    }
    reader_.finish();
    return bytes;
  }

  NpyPlace place_;
  ZipMember member_;
  ZipMemberReader reader_;
  std::size_t header_start_ = 0;
  NpyHeader header_;
};

NamedArrays read_members(const ZipReader& archive, const std::vector<std::string>& names) {
  NamedArrays arrays;
  for (const ZipMember& member : select(archive, names)) {
    NpyMember npy(archive, member);
    if (npy.numeric()) {
      arrays.emplace_back(array_name(member), npy.numbers());
    } else {
      append_numeric_leaves(npy.value(), array_name(member), npy.place(), arrays);
    }
  }
  return arrays;
}

}  // namespace

NamedArrays read_npz(const std::filesystem::path& path) { return read_members(ZipReader(path), {}); }

NamedArrays read_npz(const std::filesystem::path& path, const std::vector<std::string>& names) {
  const ZipReader archive(path);
  return names.empty() ? NamedArrays{} : read_members(archive, names);
}

NamedArrays read_npz_headers(const std::filesystem::path& path) {
  const ZipReader archive(path);
  NamedArrays headers;
  for (const ZipMember& member : select(archive, {})) {
    const NpyMember npy(archive, member);
    if (npy.numeric())
      headers.emplace_back(array_name(member), NdArray{npy.header().element.dtype, npy.header().shape, {}});
  }
  return headers;
}

std::vector<std::pair<std::string, NpzValue>> read_npz_objects(const std::filesystem::path& path,
                                                               const std::vector<std::string>& names) {
  const ZipReader archive(path);
  std::vector<std::pair<std::string, NpzValue>> values;
  for (const ZipMember& member : select(archive, names)) {
    values.emplace_back(array_name(member), NpyMember(archive, member).value());
  }
  return values;
}

void write_npz(const std::filesystem::path& path, const NamedArrays& arrays) {
  std::vector<ZipContent> members;
  members.reserve(arrays.size());
  for (const auto& [name, array] : arrays) {
    members.push_back({name + std::string(kSuffix), encode_npy(array, path.string() + ": " + name)});
  }
  write_zip(path, members);
}

}  // namespace anigen::io
