#include <gtest/gtest.h>
#include <csignal>
#include <new>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/guarded_reader.h"

namespace anigen {

namespace {

constexpr const char* kCrashed = "the reader %; export it again";

std::string read(const std::function<std::string()>& reader) { return read_guarded("a.bin", kCrashed, {}, reader); }

template <typename Refusal>
std::string refusal_of(const std::function<std::string()>& reader) {
  try {
    read(reader);
  } catch (const Refusal& error) {
    return error.what();
  }
  return "accepted";
}

TEST(GuardedReader, GivesBackWhatWasRead) {
  EXPECT_EQ(read([] { return std::string("a\0b", 3); }), std::string("a\0b", 3));
  EXPECT_EQ(read([] { return std::string(); }), "");
}

TEST(GuardedReader, RefusalsArriveAsTheyWereThrown) {
  EXPECT_EQ(refusal_of<InputError>([]() -> std::string { throw InputError("", "byte 7", "no number"); }),
            InputError("a.bin", "byte 7", "no number").what());
  EXPECT_EQ(refusal_of<NotSupportedError>([]() -> std::string { throw NotSupportedError("", "/skins/0", "curves"); }),
            NotSupportedError("a.bin", "/skins/0", "curves").what());
  EXPECT_EQ(refusal_of<InputError>([]() -> std::string { throw Error("cannot"); }),
            InputError("a.bin", "", "cannot").what());
  EXPECT_EQ(refusal_of<InputError>([]() -> std::string { throw std::bad_alloc(); }),
            InputError("a.bin", "", "reading it needs more memory than there is").what());
}

TEST(GuardedReader, ACrashIsAnErrorThatNamesTheFile) {
  EXPECT_EQ(refusal_of<InputError>([] {
              ::raise(SIGSEGV);
              return std::string();
            }),
            InputError("a.bin", "", "the reader crashed (Segmentation fault); export it again").what());
}

}  // namespace

}  // namespace anigen
