#include "anigen/core/group_lock.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

TEST(GroupLock, HasExactlyOneFirst) {
  const test::TemporaryFolder folder;
  const auto file = folder / "lock";
  std::atomic<int> firsts{0}, members{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      const auto lock = join_group(file, [&](bool first) { firsts += first ? 1 : 0; });
      ++members;
      while (members < 8) std::this_thread::yield();
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(firsts, 1);
  bool first = false;
  const auto again = join_group(file, [&](bool is_first) { first = is_first; });
  EXPECT_TRUE(first) << "the others have left";
}

TEST(GroupLock, KeepsApartMembersAndWhoWantsThePlaceAlone) {
  const test::TemporaryFolder folder;
  const auto file = folder / "lock";
  {
    const auto member = join_group(file, [](bool) {});
    EXPECT_FALSE(instead_of_group(file));
    EXPECT_FALSE(while_group_is_empty(file, [] { FAIL() << "there is a member"; }));
  }
  EXPECT_TRUE(while_group_is_empty(file, [] {}));
  const auto alone = instead_of_group(file);
  ASSERT_TRUE(alone);
  EXPECT_FALSE(join_group(file, [](bool) { FAIL() << "somebody is there"; }));
}

TEST(GroupLock, WhoIsRefusedAtTheGateIsNoMember) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(join_group(folder / "lock", [](bool) { throw InputError("", "", "not you"); }), InputError);
  EXPECT_TRUE(instead_of_group(folder / "lock"));
}

}  // namespace
}  // namespace anigen
