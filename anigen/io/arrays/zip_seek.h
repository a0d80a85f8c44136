#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "anigen/io/arrays/npz.h"

namespace anigen::io {

/// Random access to the bytes of one zip member, for members that are larger than memory should hold. A deflated one
/// is decompressed from the nearest of at most 256 states of the decompressor (40 KiB each) that were kept while it
/// was read for the first time; reading on where an earlier read ended costs nothing extra.
class SeekableMember {
 public:
  /// @param member of that archive @throws InputError when its header in the file is damaged
  SeekableMember(const ZipReader& archive, const ZipMember& member);
  ~SeekableMember();
  SeekableMember(const SeekableMember&) = delete;
  SeekableMember& operator=(const SeekableMember&) = delete;

  const std::string& file() const { return file_; }
  const std::string& name() const { return member_.name; }
  std::uint64_t size() const { return member_.bytes; }

  /// Bytes [offset, offset + bytes). Several threads may read at once. Whoever comes to the end in one pass from byte 0
  /// has compared the checksum. @throws InputError beyond the end, and for damaged or changed files
  void read(std::uint64_t offset, char* to, std::size_t bytes) const;

 private:
  struct Cursor;
  std::unique_ptr<Cursor> take(std::uint64_t offset) const;
  void put_back(std::unique_ptr<Cursor> cursor) const;
  void keep_point(const Cursor& cursor) const;
  void produce(Cursor& cursor, char* to, std::size_t bytes) const;
  void inflate_into(Cursor& cursor, char* to, std::size_t bytes) const;
  void check_end(Cursor& cursor) const;
  void locate();
  void read_file(std::uint64_t offset, void* to, std::size_t bytes) const;
  [[noreturn]] void fail(std::uint64_t at, const std::string& problem) const;

  std::string file_;
  ZipMember member_;
  int descriptor_ = -1;
  std::uint64_t data_ = 0;  ///< where its bytes begin in the file
  std::uint32_t checksum_ = 0;
  bool deflated_ = false;
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Cursor>> points_, idle_;
  mutable std::uint64_t spacing_;
};

}  // namespace anigen::io
