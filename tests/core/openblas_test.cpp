#include "anigen/core/openblas.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <set>
#include <string>

namespace anigen {
namespace {

class OpenBlas : public ::testing::Test {
 protected:
  OpenBlas() {
    const char* value = std::getenv(kVariable);
    if (value != nullptr) before_ = value;
    was_set_ = value != nullptr;
  }
  ~OpenBlas() override {
    if (was_set_) {
      ::setenv(kVariable, before_.c_str(), 1);
    } else {
      ::unsetenv(kVariable);
    }
  }
  static constexpr const char* kVariable = "OPENBLAS_CORETYPE";

 private:
  std::string before_;
  bool was_set_ = false;
};

TEST_F(OpenBlas, IsToldTheWidestKernelsThatTheProcessorRuns) {
  ::unsetenv(kVariable);
  const std::string core = openblas_core();
  EXPECT_EQ(std::set<std::string>({"", "SkylakeX", "Zen", "Haswell"}).count(core), 1U) << core;
  name_openblas_core();
  const char* value = std::getenv(kVariable);
  EXPECT_EQ(value == nullptr ? "" : std::string(value), core);
  EXPECT_EQ(openblas_details(), "OpenBLAS core " + (core.empty() ? "of its own choice" : core));
}

TEST_F(OpenBlas, UsesWhatItsOwnVariableSays) {
  ::setenv(kVariable, "Nehalem", 1);
  EXPECT_FALSE(openblas_is_slow());
  name_openblas_core();
  EXPECT_STREQ(std::getenv(kVariable), "Nehalem");
  EXPECT_EQ(openblas_details(), "OpenBLAS core Nehalem");
}

}  // namespace
}  // namespace anigen
