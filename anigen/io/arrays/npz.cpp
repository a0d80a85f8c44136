#include "anigen/io/arrays/npz.h"

#include <zip.h>
#include <algorithm>
#include <string_view>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz_objects.h"

namespace anigen::io {

struct ZipReader::Handle {
  zip_t* archive = nullptr;
  ~Handle() {
    if (archive) zip_discard(archive);
  }
};

ZipReader::ZipReader(const std::filesystem::path& path, const ZipLimits& limits)
    : file_(path.string()), limits_(limits), handle_(std::make_unique<Handle>()) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) throw InputError(file_, "", "no such file");
  const std::uint64_t file_bytes = std::filesystem::file_size(path, error);
  int code = 0;
  handle_->archive = zip_open(path.c_str(), ZIP_RDONLY, &code);
  if (!handle_->archive) {
    zip_error_t reason;
    zip_error_init_with_code(&reason, code);
    const std::string text = zip_error_strerror(&reason);
    zip_error_fini(&reason);
    throw InputError(file_, "", "cannot be opened as a zip archive (" + text + "); truncated or damaged?");
  }
  const zip_int64_t count = zip_get_num_entries(handle_->archive, 0);
  if (count < 0 || static_cast<std::uint64_t>(count) > limits_.max_members)
    throw InputError(file_, "", "zip archive with " + std::to_string(count) + " members exceeds the limit");
  std::uint64_t compressed_total = 0;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(count); ++i) {
    zip_stat_t stat;
    zip_stat_init(&stat);
    constexpr zip_uint64_t kNeeded = ZIP_STAT_NAME | ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if (zip_stat_index(handle_->archive, i, ZIP_FL_ENC_RAW, &stat) != 0 || (stat.valid & kNeeded) != kNeeded)
      throw InputError(file_, "member " + std::to_string(i), "its directory entry cannot be read");
    ZipMember member{stat.name, i, stat.size, stat.comp_size};
    check(member, stat.comp_method, (stat.valid & ZIP_STAT_ENCRYPTION_METHOD) ? stat.encryption_method : 0);
    if (member.compressed_bytes > file_bytes - compressed_total) {
      // Also catches archives whose members share the same bytes, the other way to build a bomb.
      throw InputError(file_, member.name, "its members are together larger than the file");
    }
    compressed_total += member.compressed_bytes;
    members_.push_back(std::move(member));
  }
}

ZipReader::~ZipReader() = default;

void ZipReader::check(const ZipMember& member, std::uint16_t method, std::uint16_t encryption) const {
  if (encryption != ZIP_EM_NONE) throw NotSupportedError(file_, member.name, "encrypted zip members");
  if (method != ZIP_CM_STORE && method != ZIP_CM_DEFLATE)
    throw NotSupportedError(file_, member.name, "zip compression method " + std::to_string(method));
  if (method == ZIP_CM_STORE && member.bytes != member.compressed_bytes)
    throw InputError(file_, member.name, "a stored member declares two different sizes");
  const double ratio =
      static_cast<double>(member.bytes) / std::max<double>(1.0, static_cast<double>(member.compressed_bytes));
  constexpr double kDeflateLimit = 1100;
  constexpr std::uint64_t kBlock = 4096;
  const bool impossible = member.bytes > kBlock && ratio > kDeflateLimit;
  const bool suspicious = member.bytes > limits_.ratio_applies_above && ratio > limits_.max_ratio;
  if (member.bytes > limits_.max_member_bytes || impossible || suspicious) {
    throw InputError(file_, member.name,
                     "declares " + std::to_string(member.bytes) + " bytes from " +
                         std::to_string(member.compressed_bytes) + " compressed ones; refused as a decompression bomb");
  }
}

const ZipMember* ZipReader::find(const std::string& name) const {
  // libzip keeps a hash of the names; thousands of tensors are looked up one by one.
  const zip_int64_t index = zip_name_locate(handle_->archive, name.c_str(), ZIP_FL_ENC_RAW);
  return index < 0 ? nullptr : &members_[static_cast<std::size_t>(index)];
}

/// Reads one member piece by piece.
class ZipMemberReader {
 public:
  ZipMemberReader(const ZipReader& archive, const ZipMember& member) : file_(archive.file_), member_(member) {
    handle_.reset(zip_fopen_index(archive.handle_->archive, member.index, 0));
    if (!handle_) fail(std::string("cannot be opened: ") + zip_strerror(archive.handle_->archive));
  }

  /// Exactly `bytes` more bytes. @throws InputError when the member ends early
  void read(void* destination, std::uint64_t bytes) {
    auto* out = static_cast<char*>(destination);
    while (bytes > 0) {
      const std::uint64_t piece = std::min<std::uint64_t>(bytes, std::uint64_t{1} << 30);
      const zip_int64_t got = zip_fread(handle_.get(), out, piece);
      if (got < 0) fail(std::string("damaged: ") + zip_file_strerror(handle_.get()));
      if (got == 0) fail("ends before the declared size");
      out += got;
      position_ += static_cast<std::uint64_t>(got);
      bytes -= static_cast<std::uint64_t>(got);
    }
  }

  /// All that is left, in pieces, so that a false declared size costs no memory before the data proves it; checks that
  /// the checksum agrees.
  template <typename Bytes>
  Bytes rest() {
    Bytes bytes;
    constexpr std::uint64_t kPiece = std::uint64_t{64} << 20;
    while (position_ < member_.bytes) {
      const std::size_t start = bytes.size();
      const std::uint64_t piece = std::min(kPiece, member_.bytes - position_);
      bytes.resize(start + piece);
      read(bytes.data() + start, piece);
    }
    char extra = 0;
    const zip_int64_t got = zip_fread(handle_.get(), &extra, 1);  // at the end libzip compares the checksum
    if (got < 0) fail(std::string("damaged: ") + zip_file_strerror(handle_.get()));
    if (got > 0) fail("is longer than the declared size");
    return bytes;
  }

  std::uint64_t position() const { return position_; }

 private:
  struct Close {
    void operator()(zip_file_t* file) const { zip_fclose(file); }
  };
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(file_, member_.name + ", byte " + std::to_string(position_), problem);
  }

  std::string file_;
  ZipMember member_;
  std::unique_ptr<zip_file_t, Close> handle_;
  std::uint64_t position_ = 0;
};

std::string ZipReader::read(const ZipMember& member) const {
  return ZipMemberReader(*this, member).rest<std::string>();
}

namespace {

constexpr std::uint16_t kDosDate = 1 << 5 | 1;  // 1 January 1980, the earliest there is
constexpr std::uint16_t kDosTime = 0;

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};

void add(zip_t* archive, const std::string& file, const ZipContent& content) {
  zip_source_t* source = zip_source_buffer(archive, content.bytes.data(), content.bytes.size(), 0);
  const zip_int64_t index = source ? zip_file_add(archive, content.name.c_str(), source, ZIP_FL_ENC_UTF_8) : -1;
  if (index < 0) {
    if (source) zip_source_free(source);
    throw Error(file + ": cannot add member '" + content.name + "': " + zip_strerror(archive));
  }
  const auto at = static_cast<zip_uint64_t>(index);
  if (zip_set_file_compression(archive, at, ZIP_CM_DEFLATE, 0) != 0 ||
      zip_file_set_dostime(archive, at, kDosTime, kDosDate, 0) != 0) {
    throw Error(file + ": cannot set up member '" + content.name + "': " + zip_strerror(archive));
  }
}

}  // namespace

void write_zip(const std::filesystem::path& path, const std::vector<ZipContent>& members) {
  if (members.empty()) {  // libzip deletes an archive without members instead of writing it
    constexpr std::string_view kEmptyArchive("PK\x05\x06\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0", 22);
    write_file_atomically(path, kEmptyArchive);
    return;
  }
  AtomicFile target(path);
  int code = 0;
  std::unique_ptr<zip_t, Discard> archive(zip_open(target.temporary().c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  if (!archive) throw WriteError(path.string() + ": cannot be created (zip error " + std::to_string(code) + ")");
  for (const ZipContent& content : members) add(archive.get(), path.string(), content);
  if (zip_close(archive.get()) != 0)
    throw WriteError(path.string() + ": cannot be written: " + zip_strerror(archive.get()));
  static_cast<void>(archive.release());  // zip_close freed it
  target.commit();
}

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
      const std::string present = joined(select(archive, {}), ", ", array_name);
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
    std::string start(8, '\0');
    constexpr std::size_t kMagic = 6, kVersion = 2;
    need(kMagic + kVersion + 2);
    reader_.read(start.data(), kMagic + kVersion);
    if (start.substr(0, kMagic) != "\x93NUMPY")
      throw InputError(place_.file, place_.member + ", byte 0", "not an NPY array");
    const int major = static_cast<unsigned char>(start[6]);
    if (major < 1 || major > 3) place_.refuse("NPY version " + std::to_string(major));
    const std::size_t length_bytes = major == 1 ? 2 : 4;
    need(kMagic + kVersion + length_bytes);
    reader_.read(start.data(), length_bytes);
    const std::uint64_t length = little_endian(start.substr(0, length_bytes));
    constexpr std::size_t kMaxHeader = 1 << 20;
    if (length > kMaxHeader) place_.fail("NPY header of implausible length");
    header_start_ = static_cast<std::size_t>(reader_.position());
    need(header_start_ + length);
    std::string text(length, '\0');
    reader_.read(text.data(), length);
    header_ = parse_npy_header(text, header_start_, place_);
    check_size();
  }

  const NpyHeader& header() const { return header_; }
  std::uint64_t data() const { return reader_.position(); }  ///< before they are read
  const NpyPlace& place() const { return place_; }
  bool numeric() const { return header_.element.kind == NpyElement::Kind::kNumber; }

  NdArray numbers() { return decode_npy(header_, reader_.rest<std::vector<std::uint8_t>>(), place_); }

  NpzValue value() {
    if (numeric()) {
      NpzValue value;
      value.kind = NpzValue::Kind::kArray;
      value.array = numbers();
      return value;
    }
    const auto start = static_cast<std::size_t>(reader_.position());
    if (header_.element.kind != NpyElement::Kind::kObject)
      return decode_text_array(header_, reader_.rest<std::string>(), place_);
    if (header_.fortran_order && header_.shape.size() > 1) place_.refuse("object arrays in Fortran order");
    return unpickle_object_array(reader_.rest<std::string>(), header_.shape, start, place_);
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
    if (!count_elements(header_.shape, header_.element.size, count)) place_.fail("its shape overflows");
    if (header_.element.kind == NpyElement::Kind::kObject) return;
    const std::uint64_t there = member_.bytes - reader_.position(), needed = count * header_.element.size;
    if (needed != there)
      place_.fail("its shape needs " + std::to_string(needed) + " bytes of data and " + std::to_string(there) +
                  " are there");
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

NpyMemberHeader read_npy_header(const ZipReader& archive, const ZipMember& member) {
  const NpyMember npy(archive, member);
  return {npy.header(), npy.data()};
}

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
  for (const ZipMember& member : select(archive, names))
    values.emplace_back(array_name(member), NpyMember(archive, member).value());
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
