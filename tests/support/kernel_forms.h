#pragma once
#include <gtest/gtest.h>

#include "anigen/core/kernel_form.h"

namespace anigen::test {

/// Calls check() once in every form of the kernels that this processor runs, the portable one first.
template <typename Check>
void in_every_kernel_form(const Check& check) {
  for (const KernelForm form : runnable_kernel_forms()) {
    SCOPED_TRACE(std::string("kernels ") + kernel_form_name(form));
    const KernelFormScope scope(form);
    check();
    if (::testing::Test::HasFatalFailure()) return;
  }
}

}  // namespace anigen::test

/// TEST whose body runs once in every form of the kernels.
#define KERNEL_TEST(SUITE, NAME)                                                            \
  static void SUITE##_##NAME##_in_one_form();                                               \
  TEST(SUITE, NAME) { ::anigen::test::in_every_kernel_form(SUITE##_##NAME##_in_one_form); } \
  static void SUITE##_##NAME##_in_one_form()
