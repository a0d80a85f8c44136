#include <zip.h>

#include <memory>
#include <string_view>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/arrays/zip_archive.h"

namespace anigen::io {
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
  if (zip_close(archive.get()) != 0) {
    throw WriteError(path.string() + ": cannot be written: " + zip_strerror(archive.get()));
  }
  archive.release();  // zip_close freed it
  target.commit();
}

}  // namespace anigen::io
