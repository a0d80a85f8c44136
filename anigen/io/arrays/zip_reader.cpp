#include <zip.h>

#include <algorithm>
#include <limits>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::io {

struct ZipReader::Handle {
  zip_t* archive = nullptr;
  ~Handle() {
    if (archive) zip_discard(archive);
  }
};

struct ZipMemberReader::Handle {
  zip_file_t* file = nullptr;
  ~Handle() {
    if (file) zip_fclose(file);
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
  if (count < 0 || static_cast<std::uint64_t>(count) > limits_.max_members) {
    throw InputError(file_, "", "zip archive with " + std::to_string(count) + " members exceeds the limit");
  }
  std::uint64_t compressed_total = 0;
  for (zip_uint64_t i = 0; i < static_cast<zip_uint64_t>(count); ++i) {
    zip_stat_t stat;
    zip_stat_init(&stat);
    constexpr zip_uint64_t kNeeded = ZIP_STAT_NAME | ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if (zip_stat_index(handle_->archive, i, ZIP_FL_ENC_RAW, &stat) != 0 || (stat.valid & kNeeded) != kNeeded) {
      throw InputError(file_, "member " + std::to_string(i), "its directory entry cannot be read");
    }
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
  if (method != ZIP_CM_STORE && method != ZIP_CM_DEFLATE) {
    throw NotSupportedError(file_, member.name, "zip compression method " + std::to_string(method));
  }
  if (method == ZIP_CM_STORE && member.bytes != member.compressed_bytes) {
    throw InputError(file_, member.name, "a stored member declares two different sizes");
  }
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

std::string ZipReader::read(const ZipMember& member) const {
  ZipMemberReader reader(*this, member);
  std::string bytes;
  // In pieces, so that a false declared size costs no memory before the data proves it.
  constexpr std::uint64_t kPiece = std::uint64_t{64} << 20;
  while (bytes.size() < member.bytes) {
    const std::size_t start = bytes.size();
    const std::uint64_t piece = std::min<std::uint64_t>(kPiece, member.bytes - start);
    bytes.resize(start + piece);
    reader.read(bytes.data() + start, piece);
  }
  reader.finish();
  return bytes;
}

ZipMemberReader::ZipMemberReader(const ZipReader& archive, const ZipMember& member)
    : file_(archive.file_), member_(member), handle_(std::make_unique<Handle>()) {
  handle_->file = zip_fopen_index(archive.handle_->archive, member.index, 0);
  if (!handle_->file) fail(std::string("cannot be opened: ") + zip_strerror(archive.handle_->archive));
}

ZipMemberReader::~ZipMemberReader() = default;

void ZipMemberReader::fail(const std::string& problem) const {
  throw InputError(file_, member_.name + ", byte " + std::to_string(position_), problem);
}

void ZipMemberReader::read(void* destination, std::uint64_t bytes) {
  auto* out = static_cast<char*>(destination);
  while (bytes > 0) {
    const std::uint64_t piece = std::min<std::uint64_t>(bytes, std::uint64_t{1} << 30);
    const zip_int64_t got = zip_fread(handle_->file, out, piece);
    if (got < 0) fail(std::string("damaged: ") + zip_file_strerror(handle_->file));
    if (got == 0) fail("ends before the declared size");
    out += got;
    position_ += static_cast<std::uint64_t>(got);
    bytes -= static_cast<std::uint64_t>(got);
  }
}

void ZipMemberReader::finish() {
  if (position_ != member_.bytes) fail(std::to_string(member_.bytes - position_) + " unexpected bytes follow");
  char extra = 0;
  const zip_int64_t got = zip_fread(handle_->file, &extra, 1);  // reaching the end makes libzip compare the checksum
  if (got < 0) fail(std::string("damaged: ") + zip_file_strerror(handle_->file));
  if (got > 0) fail("is longer than the declared size");
}

}  // namespace anigen::io
