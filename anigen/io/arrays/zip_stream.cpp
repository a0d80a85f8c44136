#include "anigen/io/arrays/zip_stream.h"

#include <zlib.h>
#include <algorithm>

#include "anigen/core/error.h"

namespace anigen::io {

namespace {

constexpr std::uint64_t kWideSize = 0xFFFFFFFF;  // stands for "see the zip64 field"
constexpr std::uint64_t kManyMembers = 0xFFFF;

/// Little endian.
std::string fixed_width(std::uint64_t value, int bytes) {
  std::string text;
  for (int i = 0; i < bytes; ++i, value >>= 8) text += static_cast<char>(value & 0xFF);
  return text;
}

/// Version, flags, method and the date 1980-01-01, as both headers have them.
std::string common_fields(bool deflated) {
  constexpr std::uint64_t kVersion = 45, kDate = 1 << 5 | 1, kDeflated = 8;
  return fixed_width(kVersion, 2) + fixed_width(0, 2) + fixed_width(deflated ? kDeflated : 0, 2) + fixed_width(0, 2) +
         fixed_width(kDate, 2);
}

}  // namespace

struct ZipStream::Deflate {
  z_stream stream{};
  Deflate() {
    if (deflateInit2(&stream, Z_DEFAULT_COMPRESSION, Z_DEFLATED, -MAX_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
      throw Error("no memory to compress");
  }
  Deflate(const Deflate&) = delete;
  Deflate& operator=(const Deflate&) = delete;
  ~Deflate() { deflateEnd(&stream); }
};

ZipStream::ZipStream(const std::filesystem::path& path)
    : target_(path), file_(path.string()), out_(target_.temporary(), std::ios::binary | std::ios::trunc) {
  if (!out_) throw WriteError(file_ + ": cannot be created");
}

ZipStream::~ZipStream() = default;

void ZipStream::put(std::string_view bytes) {
  out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!out_) throw WriteError(file_ + ": cannot be written");
  position_ += bytes.size();
}

void ZipStream::begin(const std::string& name, bool deflated) {
  end();
  members_.push_back({name, deflated, position_, 0, 0, 0});
  // Checksum and sizes are filled in by end().
  put(fixed_width(0x04034b50, 4) + common_fields(deflated) + fixed_width(0, 4) + fixed_width(kWideSize, 4) +
      fixed_width(kWideSize, 4) + fixed_width(name.size(), 2) + fixed_width(20, 2) + name + fixed_width(1, 2) +
      fixed_width(16, 2) + fixed_width(0, 8) + fixed_width(0, 8));
  if (deflated) stream_ = std::make_unique<Deflate>();
  open_ = true;
}

void ZipStream::deflate(std::string_view bytes, bool last) {
  z_stream& stream = stream_->stream;
  char piece[1 << 16];
  // zlib does not write to its input.
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  do {
    stream.next_out = reinterpret_cast<Bytef*>(piece);
    stream.avail_out = sizeof piece;
    ::deflate(&stream, last ? Z_FINISH : Z_NO_FLUSH);
    const std::size_t made = sizeof piece - stream.avail_out;
    put({piece, made});
    members_.back().compressed += made;
  } while (stream.avail_out == 0);
}

void ZipStream::write(std::string_view bytes) {
  Member& member = members_.back();
  constexpr std::size_t kPiece = std::size_t{1} << 28;  // zlib counts in 32 bits
  while (!bytes.empty()) {
    const std::string_view piece = bytes.substr(0, kPiece);
    bytes.remove_prefix(piece.size());
    member.checksum = static_cast<std::uint32_t>(
        crc32(member.checksum, reinterpret_cast<const Bytef*>(piece.data()), static_cast<uInt>(piece.size())));
    member.bytes += piece.size();
    if (member.deflated) {
      deflate(piece, false);
    } else {
      put(piece);
      member.compressed += piece.size();
    }
  }
}

void ZipStream::end() {
  if (!open_) return;
  open_ = false;
  Member& member = members_.back();
  if (member.deflated) deflate({}, true);
  stream_.reset();
  constexpr std::uint64_t kChecksumAt = 14, kHeader = 30;
  const auto fill = [this](std::uint64_t at, const std::string& bytes) {
    out_.seekp(static_cast<std::streamoff>(at));
    out_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  };
  fill(member.offset + kChecksumAt, fixed_width(member.checksum, 4));
  fill(member.offset + kHeader + member.name.size() + 4,
       fixed_width(member.bytes, 8) + fixed_width(member.compressed, 8));
  out_.seekp(static_cast<std::streamoff>(position_));
  if (!out_) throw WriteError(file_ + ": cannot be written");
}

void ZipStream::write_directory() {
  const std::uint64_t begin = position_;
  const auto narrow = [](std::uint64_t value) { return std::min(value, kWideSize); };
  for (const Member& member : members_) {
    std::string wide;
    for (const std::uint64_t value : {member.bytes, member.compressed, member.offset}) {
      if (value >= kWideSize) wide += fixed_width(value, 8);
    }
    if (!wide.empty()) wide = fixed_width(1, 2) + fixed_width(wide.size(), 2) + wide;
    put(fixed_width(0x02014b50, 4) + fixed_width(45, 2) + common_fields(member.deflated) +
        fixed_width(member.checksum, 4) + fixed_width(narrow(member.compressed), 4) +
        fixed_width(narrow(member.bytes), 4) + fixed_width(member.name.size(), 2) + fixed_width(wide.size(), 2) +
        fixed_width(0, 10) + fixed_width(narrow(member.offset), 4) + member.name + wide);
  }
  const std::uint64_t bytes = position_ - begin, count = members_.size();
  if (begin >= kWideSize || count >= kManyMembers) {
    const std::uint64_t record = position_;
    put(fixed_width(0x06064b50, 4) + fixed_width(44, 8) + fixed_width(45, 2) + fixed_width(45, 2) + fixed_width(0, 8) +
        fixed_width(count, 8) + fixed_width(count, 8) + fixed_width(bytes, 8) + fixed_width(begin, 8));
    put(fixed_width(0x07064b50, 4) + fixed_width(0, 4) + fixed_width(record, 8) + fixed_width(1, 4));
  }
  const std::string told = fixed_width(std::min(count, kManyMembers), 2);
  put(fixed_width(0x06054b50, 4) + fixed_width(0, 4) + told + told + fixed_width(narrow(bytes), 4) +
      fixed_width(narrow(begin), 4) + fixed_width(0, 2));
}

void ZipStream::commit() {
  end();
  write_directory();
  out_.close();
  if (!out_) throw WriteError(file_ + ": cannot be written");
  target_.commit();
}

}  // namespace anigen::io
