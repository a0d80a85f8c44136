#pragma once
#include <atomic>
#include <string>
#include <vector>

namespace anigen {

/// Instruction sets that our own kernels are compiled for; each includes those before it. LibTorch, oneDNN and OpenBLAS
/// choose theirs themselves.
enum class KernelForm {
  kPortable,    ///< what every processor of the architecture has
  kAvx2,        ///< AVX2 and fused multiply-adds
  kAvx512,      ///< AVX-512 F
  kAvx512Bf16,  ///< AVX-512 with products of pairs of bf16 numbers
  kAmx          ///< AMX: tiles of bf16 numbers
};

/// Name of a form as ANIGEN_KERNELS takes it: portable, avx2, avx512, avx512bf16 or amx.
const char* kernel_form_name(KernelForm form);

/// Forms that this processor runs, kPortable first, the widest last.
const std::vector<KernelForm>& runnable_kernel_forms();

/// Form that a value of ANIGEN_KERNELS asks for. @param value empty: the widest
/// @throws InputError for an unknown name, and for a form that this processor does not run
KernelForm requested_kernel_form(const std::string& value);

namespace kernel_forms {
extern std::atomic<int> current;  // −1 until somebody asks
KernelForm first_choice();
}  // namespace kernel_forms

/// Form in which kernels run: the one that the environment variable ANIGEN_KERNELS names, else the widest. The variable
/// is read at the first call. @throws InputError as requested_kernel_form, at the first call
inline KernelForm kernel_form() {
  const int form = kernel_forms::current.load(std::memory_order_relaxed);
  return form >= 0 ? static_cast<KernelForm>(form) : kernel_forms::first_choice();
}

/// Line for --version: the form in use, and those that this processor runs.
std::string kernel_form_details();

/// Makes kernels run in another form while it lives. Must not be made or destroyed while kernels run.
class KernelFormScope {
 public:
  /// @throws InputError when this processor does not run the form
  explicit KernelFormScope(KernelForm form);
  ~KernelFormScope();
  KernelFormScope(const KernelFormScope&) = delete;
  KernelFormScope& operator=(const KernelFormScope&) = delete;

 private:
  KernelForm before_;
};

}  // namespace anigen

/// Defines a function that is compiled once per form and runs in the form in use; its body follows. What it calls in
/// its loops is marked ANIGEN_KERNEL_INLINE.
///   ANIGEN_KERNEL(void, twice, (float* x, std::int64_t n), (x, n)) { for (…) x[i] *= 2.0F; }
/// ANIGEN_EXACT_KERNEL has no form that fuses multiplications with additions, so that all give the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ANIGEN_KERNEL_INLINE inline __attribute__((always_inline))
#define ANIGEN_KERNEL(RESULT, NAME, PARAMETERS, ARGUMENTS)                                                    \
  static ANIGEN_KERNEL_INLINE RESULT NAME##_body PARAMETERS;                                                  \
  __attribute__((target("avx2"))) static RESULT NAME##_avx2 PARAMETERS { return NAME##_body ARGUMENTS; }      \
  __attribute__((target("avx512f"))) static RESULT NAME##_avx512 PARAMETERS { return NAME##_body ARGUMENTS; } \
  RESULT NAME PARAMETERS {                                                                                    \
    const ::anigen::KernelForm form = ::anigen::kernel_form();                                                \
    if (form >= ::anigen::KernelForm::kAvx512) return NAME##_avx512 ARGUMENTS;                                \
    if (form >= ::anigen::KernelForm::kAvx2) return NAME##_avx2 ARGUMENTS;                                    \
    return NAME##_body ARGUMENTS;                                                                             \
  }                                                                                                           \
  static ANIGEN_KERNEL_INLINE RESULT NAME##_body PARAMETERS
#define ANIGEN_EXACT_KERNEL(RESULT, NAME, PARAMETERS, ARGUMENTS)                                         \
  static ANIGEN_KERNEL_INLINE RESULT NAME##_body PARAMETERS;                                             \
  __attribute__((target("avx2"))) static RESULT NAME##_avx2 PARAMETERS { return NAME##_body ARGUMENTS; } \
  RESULT NAME PARAMETERS {                                                                               \
    if (::anigen::kernel_form() >= ::anigen::KernelForm::kAvx2) return NAME##_avx2 ARGUMENTS;            \
    return NAME##_body ARGUMENTS;                                                                        \
  }                                                                                                      \
  static ANIGEN_KERNEL_INLINE RESULT NAME##_body PARAMETERS
#else
#define ANIGEN_KERNEL_INLINE inline
#define ANIGEN_KERNEL(RESULT, NAME, PARAMETERS, ARGUMENTS) RESULT NAME PARAMETERS
#define ANIGEN_EXACT_KERNEL(RESULT, NAME, PARAMETERS, ARGUMENTS) RESULT NAME PARAMETERS
#endif
