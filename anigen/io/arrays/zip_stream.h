#pragma once
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/files.h"

namespace anigen::io {

/// Writes a zip archive whose members come piece by piece, so that none is held in memory. Equal content gives equal
/// bytes; sizes beyond 4 GiB and any number of members are told by zip64. The file appears with commit().
class ZipStream {
 public:
  explicit ZipStream(const std::filesystem::path& path);
  ~ZipStream();

  /// Begins a member, deflated or stored, and ends the one before it.
  void begin(const std::string& name, bool deflated);
  /// More of the member that was begun. @throws WriteError when the disk refuses
  void write(std::string_view bytes);
  void commit();

 private:
  struct Member {
    std::string name;
    bool deflated = false;
    std::uint64_t offset = 0, bytes = 0, compressed = 0;
    std::uint32_t checksum = 0;
  };
  struct Deflate;
  void put(std::string_view bytes);
  void deflate(std::string_view bytes, bool last);
  void end();
  void write_directory();

  AtomicFile target_;
  std::string file_;
  std::ofstream out_;
  std::uint64_t position_ = 0;
  std::vector<Member> members_;
  std::unique_ptr<Deflate> stream_;
  bool open_ = false;
};

}  // namespace anigen::io
