#include "anigen/core/hash.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

// Vectors of FIPS 180-4 and of NIST's example values.
TEST(Sha256, AgreesWithThePublishedVectors) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1'000'000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, DoesNotDependOnHowTheBytesArrive) {
  std::string text;
  for (int i = 0; i < 300; ++i) text += static_cast<char>(i * 7);
  for (std::size_t step : {1u, 55u, 56u, 63u, 64u, 65u, 128u}) {
    Sha256 pieces;
    for (std::size_t i = 0; i < text.size(); i += step) pieces.update(std::string_view(text).substr(i, step));
    EXPECT_EQ(pieces.finish(), sha256(text)) << "pieces of " << step;
  }
}

TEST(Sha256, OfAFileIsThatOfItsBytes) {
  const test::TemporaryFolder folder;
  const std::string text(3'000'000, 'x');
  write_file_atomically(folder.path() / "large", text);
  EXPECT_EQ(sha256_of_file(folder.path() / "large"), sha256(text));
  write_file_atomically(folder.path() / "empty", "");
  EXPECT_EQ(sha256_of_file(folder.path() / "empty"), sha256(""));
  EXPECT_THROW(sha256_of_file(folder.path() / "none"), InputError);
}

}  // namespace
}  // namespace anigen
