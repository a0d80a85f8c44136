#include "anigen/io/arrays/zip_seek.h"

#include <fcntl.h>
#include <unistd.h>
#include <zlib.h>
#include <algorithm>
#include <array>
#include <cerrno>

#include "anigen/core/error.h"

namespace anigen::io {

namespace {

constexpr std::uint64_t kFirstSpacing = std::uint64_t{1} << 20;  // between kept states; doubles when there are too many
constexpr std::size_t kMostPoints = 256, kMostIdle = 8;
constexpr std::size_t kPiece = std::size_t{1} << 16;

std::uint64_t little(const unsigned char* bytes, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = count; i-- > 0;) value = value << 8 | bytes[i];
  return value;
}

}  // namespace

/// A decompressor, or for a stored member a position, and the checksum of all before it.
struct SeekableMember::Cursor {
  z_stream stream{};
  bool ready = false;            ///< stream is initialised
  bool from_start = true;        ///< the checksum covers every byte before `at`
  std::uint64_t at = 0, in = 0;  ///< bytes given out; compressed bytes used up
  uLong checksum = crc32(0, nullptr, 0);
  std::vector<unsigned char> input;

  Cursor() = default;
  Cursor(const Cursor&) = delete;
  Cursor& operator=(const Cursor&) = delete;
  ~Cursor() {
    if (ready) inflateEnd(&stream);
  }

  /// The state without the input read ahead. @return null when memory is short
  std::unique_ptr<Cursor> copy() const {
    auto other = std::make_unique<Cursor>();
    if (ready) {
      // inflateCopy only reads the state of its source.
      if (inflateCopy(&other->stream, const_cast<z_stream*>(&stream)) != Z_OK) return nullptr;
      other->ready = true;
      other->stream.avail_in = 0;
      other->stream.next_in = nullptr;
    }
    other->from_start = from_start;
    other->at = at;
    other->in = in - stream.avail_in;
    other->checksum = checksum;
    return other;
  }
};

SeekableMember::SeekableMember(const ZipReader& archive, const ZipMember& member)
    : file_(archive.file()), member_(member), spacing_(kFirstSpacing) {
  descriptor_ = ::open(file_.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0) throw InputError(file_, "", "cannot be opened");
  try {
    locate();
    auto start = std::make_unique<Cursor>();
    if (deflated_) {
      if (inflateInit2(&start->stream, -MAX_WBITS) != Z_OK) throw Error(file_ + ": no memory to decompress");
      start->ready = true;
    }
    points_.push_back(std::move(start));
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

SeekableMember::~SeekableMember() { ::close(descriptor_); }

void SeekableMember::fail(std::uint64_t at, const std::string& problem) const {
  throw InputError(file_, member_.name + ", byte " + std::to_string(at), problem);
}

void SeekableMember::read_file(std::uint64_t offset, void* to, std::size_t bytes) const {
  auto* out = static_cast<char*>(to);
  while (bytes > 0) {
    const ssize_t got = ::pread(descriptor_, out, bytes, static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) throw InputError(file_, "byte " + std::to_string(offset), "the file ends early, or cannot be read");
    out += got;
    offset += static_cast<std::uint64_t>(got);
    bytes -= static_cast<std::size_t>(got);
  }
}

/// libzip does not say where a member lies: its entry of the central directory does.
void SeekableMember::locate() {
  const off_t end = ::lseek(descriptor_, 0, SEEK_END);
  constexpr std::size_t kEndRecord = 22, kLocator = 20, kEntry = 46, kLocal = 30, kMostComment = 65535;
  const auto damaged = [this] { throw InputError(file_, member_.name, "the archive's directory is damaged"); };
  if (end < static_cast<off_t>(kEndRecord)) damaged();
  const auto size = static_cast<std::uint64_t>(end);
  std::vector<unsigned char> tail(std::min<std::uint64_t>(size, kEndRecord + kMostComment + kLocator));
  read_file(size - tail.size(), tail.data(), tail.size());
  std::size_t record = tail.size() - kEndRecord + 1;
  do {
    if (record-- == 0) damaged();
  } while (little(&tail[record], 4) != 0x06054b50);
  std::uint64_t directory = little(&tail[record + 16], 4);
  if (record >= kLocator && little(&tail[record - kLocator], 4) == 0x07064b50) {
    std::array<unsigned char, 56> wide{};
    read_file(little(&tail[record - kLocator + 8], 8), wide.data(), wide.size());
    if (little(wide.data(), 4) != 0x06064b50) damaged();
    directory = little(&wide[48], 8);
  }
  std::array<unsigned char, kEntry> entry{};
  std::uint64_t at = directory;
  for (std::uint64_t i = 0;; ++i) {
    if (at >= size) damaged();
    read_file(at, entry.data(), entry.size());
    if (little(entry.data(), 4) != 0x02014b50) damaged();
    const std::uint64_t rest = little(&entry[28], 2) + little(&entry[30], 2) + little(&entry[32], 2);
    if (i == member_.index) break;
    at += kEntry + rest;
  }
  const std::uint64_t name = little(&entry[28], 2), extra = little(&entry[30], 2);
  std::vector<unsigned char> more(name + extra);
  read_file(at + kEntry, more.data(), more.size());
  if (std::string(more.begin(), more.begin() + static_cast<std::ptrdiff_t>(name)) != member_.name) damaged();
  deflated_ = little(&entry[10], 2) == 8;
  checksum_ = static_cast<std::uint32_t>(little(&entry[16], 4));
  std::uint64_t local = little(&entry[42], 4);
  constexpr std::uint64_t kWide = 0xFFFFFFFF;
  for (std::size_t e = name; e + 4 <= more.size() && local == kWide;) {
    const std::size_t length = little(&more[e + 2], 2), wide_id = 1;
    if (little(&more[e], 2) == wide_id) {
      // Only fields that did not fit are there: size, compressed size, offset.
      const std::size_t before = 8 * (std::size_t{little(&entry[24], 4) == kWide} + (little(&entry[20], 4) == kWide));
      if (before + 8 > length || e + 4 + before + 8 > more.size()) damaged();
      local = little(&more[e + 4 + before], 8);
      break;
    }
    e += 4 + length;
  }
  std::array<unsigned char, kLocal> header{};
  if (local >= size) damaged();
  read_file(local, header.data(), header.size());
  if (little(header.data(), 4) != 0x04034b50) damaged();
  data_ = local + kLocal + little(&header[26], 2) + little(&header[28], 2);
  if (data_ > size || member_.compressed_bytes > size - data_) damaged();
}

std::unique_ptr<SeekableMember::Cursor> SeekableMember::take(std::uint64_t offset) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  auto best = idle_.end();
  for (auto it = idle_.begin(); it != idle_.end(); ++it) {
    if ((*it)->at <= offset && (best == idle_.end() || (*it)->at > (*best)->at)) best = it;
  }
  const auto beyond = std::upper_bound(points_.begin(), points_.end(), offset,
                                       [](std::uint64_t wanted, const auto& point) { return wanted < point->at; });
  const Cursor& point = **std::prev(beyond);  // the first is at 0
  if (best != idle_.end() && (*best)->at >= point.at) {
    std::unique_ptr<Cursor> cursor = std::move(*best);
    idle_.erase(best);
    return cursor;
  }
  std::unique_ptr<Cursor> cursor = point.copy();
  if (!cursor) throw Error(file_ + ": no memory to decompress");
  return cursor;
}

void SeekableMember::put_back(std::unique_ptr<Cursor> cursor) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  idle_.push_back(std::move(cursor));
  if (idle_.size() > kMostIdle)
    idle_.erase(
        std::min_element(idle_.begin(), idle_.end(), [](const auto& a, const auto& b) { return a->at < b->at; }));
}

void SeekableMember::keep_point(const Cursor& cursor) const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (cursor.at < points_.back()->at + spacing_) return;
  std::unique_ptr<Cursor> point = cursor.copy();
  if (!point) return;  // reading is only slower without it
  points_.push_back(std::move(point));
  if (points_.size() <= kMostPoints) return;
  for (std::size_t i = 0; 2 * i < points_.size(); ++i) {
    if (i > 0) points_[i] = std::move(points_[2 * i]);
  }
  points_.resize((points_.size() + 1) / 2);
  spacing_ *= 2;
}

void SeekableMember::inflate_into(Cursor& cursor, char* to, std::size_t bytes) const {
  z_stream& stream = cursor.stream;
  stream.next_out = reinterpret_cast<Bytef*>(to);
  stream.avail_out = static_cast<uInt>(bytes);
  while (stream.avail_out > 0) {
    if (stream.avail_in == 0) {
      cursor.input.resize(kPiece);
      const std::size_t piece = std::min<std::uint64_t>(kPiece, member_.compressed_bytes - cursor.in);
      read_file(data_ + cursor.in, cursor.input.data(), piece);
      cursor.in += piece;
      stream.next_in = cursor.input.data();
      stream.avail_in = static_cast<uInt>(piece);
    }
    const uInt left = stream.avail_out, unused = stream.avail_in;
    const int code = inflate(&stream, Z_NO_FLUSH);
    const std::uint64_t at = cursor.at + bytes - stream.avail_out;
    if (code == Z_STREAM_END && stream.avail_out > 0) fail(at, "ends before the declared size");
    if (code == Z_STREAM_END) break;
    if (code != Z_OK || (stream.avail_out == left && stream.avail_in == unused))
      fail(at, std::string("damaged: ") + (stream.msg == nullptr ? "its compressed data end early" : stream.msg));
  }
}

/// At the last byte: nothing may follow, and the checksum must agree.
void SeekableMember::check_end(Cursor& cursor) const {
  if (deflated_) {
    char extra = 0;
    z_stream& stream = cursor.stream;
    stream.next_out = reinterpret_cast<Bytef*>(&extra);
    stream.avail_out = 1;
    int code = Z_OK;
    while (code == Z_OK && stream.avail_out > 0) {
      if (stream.avail_in == 0 && cursor.in < member_.compressed_bytes) {
        cursor.input.resize(1);
        read_file(data_ + cursor.in++, cursor.input.data(), 1);
        stream.next_in = cursor.input.data();
        stream.avail_in = 1;
      }
      code = inflate(&stream, Z_NO_FLUSH);
    }
    if (stream.avail_out == 0) fail(cursor.at, "is longer than the declared size");
    if (code != Z_STREAM_END) fail(cursor.at, "damaged at its end");
  }
  if (cursor.from_start && cursor.checksum != checksum_) fail(cursor.at, "damaged: its checksum is wrong");
}

void SeekableMember::produce(Cursor& cursor, char* to, std::size_t bytes) const {
  while (bytes > 0) {
    const std::size_t piece = std::min(bytes, 4 * kPiece);
    if (deflated_)
      inflate_into(cursor, to, piece);
    else
      read_file(data_ + cursor.at, to, piece);
    cursor.checksum = crc32(cursor.checksum, reinterpret_cast<const Bytef*>(to), static_cast<uInt>(piece));
    cursor.at += piece;
    to += piece;
    bytes -= piece;
    if (deflated_) keep_point(cursor);
    if (cursor.at == member_.bytes) check_end(cursor);
  }
}

void SeekableMember::read(std::uint64_t offset, char* to, std::size_t bytes) const {
  if (offset > size() || bytes > size() - offset) fail(size(), "ends before byte " + std::to_string(offset + bytes));
  if (bytes == 0) return;
  std::unique_ptr<Cursor> cursor = take(offset);
  // A short gap, such as an array's header, is read, so that the checksum covers a pass behind it, too.
  if (!deflated_ && offset - cursor->at > kPiece) {
    cursor->at = offset;
    cursor->from_start = false;
  }
  std::vector<char> skipped(std::min<std::uint64_t>(kPiece, offset - cursor->at));
  while (cursor->at < offset)
    produce(*cursor, skipped.data(), std::min<std::uint64_t>(skipped.size(), offset - cursor->at));
  produce(*cursor, to, bytes);
  if (cursor->at < size()) put_back(std::move(cursor));
}

}  // namespace anigen::io
