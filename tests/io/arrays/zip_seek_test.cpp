#include "anigen/io/arrays/zip_seek.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "anigen/core/random.h"
#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io {
namespace {

/// Half noise, half repetition: deflate shortens it, and not by much.
std::string half_noise(std::size_t bytes) {
  Rng rng(3, "half noise");
  std::string text(bytes, 'a');
  for (std::size_t i = 0; i < bytes; ++i) {
    if (i / 1000 % 2 == 0) text[i] = static_cast<char>(rng.index(256));
  }
  return text;
}

class ZipSeek : public testing::Test {
 protected:
  /// @param deflated else stored
  std::filesystem::path archive(const std::string& content, bool deflated) const {
    const std::filesystem::path path = folder_ / "a.zip";
    if (deflated)
      write_zip(path, {{"first", "other"}, {"member", content}});
    else
      test::write_quickly(path, test::stored_zip({{"first", "other"}, {"member", content}}));
    return path;
  }
  static std::string part(const SeekableMember& member, std::size_t offset, std::size_t bytes) {
    std::string text(bytes, '\0');
    member.read(offset, text.data(), bytes);
    return text;
  }
  test::TemporaryFolder folder_;
};

TEST_F(ZipSeek, ReadsAnyPartInAnyOrder) {
  const std::string content = half_noise(9'000'000);
  for (const bool deflated : {false, true}) {
    const ZipReader archive(this->archive(content, deflated));
    const SeekableMember member(archive, *archive.find("member"));
    ASSERT_EQ(member.size(), content.size());
    EXPECT_EQ(part(member, 8'999'990, 10), content.substr(8'999'990));
    Rng rng(1, "parts");
    for (int i = 0; i < 60; ++i) {
      const std::size_t offset = rng.index(content.size()), bytes = rng.index(content.size() - offset + 1) / 16;
      EXPECT_TRUE(part(member, offset, bytes) == content.substr(offset, bytes)) << offset << " + " << bytes;
    }
    EXPECT_TRUE(part(member, 0, content.size()) == content);
    EXPECT_THROW(part(member, content.size(), 1), InputError);
    EXPECT_THROW(part(member, content.size() + 1, 0), InputError);
    EXPECT_EQ(part(member, content.size(), 0), "");
  }
}

TEST_F(ZipSeek, SeveralThreadsReadAtOnce) {
  const std::string content = half_noise(4'000'000);
  const ZipReader archive(this->archive(content, true));
  const SeekableMember member(archive, *archive.find("member"));
  std::vector<int> wrong(4, 0);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < wrong.size(); ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t offset = 100 * t; offset + 5000 < content.size(); offset += 150'000)
        wrong[t] += part(member, offset, 5000) != content.substr(offset, 5000);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, std::vector<int>(4, 0));
}

TEST_F(ZipSeek, DamageIsFoundByReadingToTheEnd) {
  const std::string content = half_noise(300'000);
  for (const bool deflated : {false, true}) {
    const std::filesystem::path path = archive(content, deflated);
    std::string bytes = read_file(path, 1 << 24);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    test::write_quickly(path, bytes);
    const ZipReader archive(path);
    const SeekableMember member(archive, *archive.find("member"));
    EXPECT_THROW(part(member, 0, content.size()), InputError) << deflated;
  }
}

TEST_F(ZipSeek, DamagedArchivesAreRefused) {
  const auto read = [](const std::filesystem::path& path) {
    const ZipReader archive(path);
    for (const ZipMember& member : archive.members()) {
      const SeekableMember seekable(archive, member);
      std::string text(std::min<std::uint64_t>(seekable.size(), 1 << 20), '\0');
      seekable.read(0, text.data(), text.size());
    }
  };
  for (const bool deflated : {false, true}) {
    const std::string bytes = read_file(archive(half_noise(3000), deflated), 1 << 20);
    EXPECT_GT(test::read_damaged(bytes, "d.zip", read), 100);
  }
}

}  // namespace
}  // namespace anigen::io
