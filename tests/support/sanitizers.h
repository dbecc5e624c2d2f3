// Whether these tests run under a sanitizer, which multiplies memory and time.
#pragma once

namespace lamina {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

}  // namespace lamina
