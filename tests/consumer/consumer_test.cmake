# Installs Lamina into a scratch folder, builds the consumer against it, runs it, and configures the
# consumer with Lamina as a part of its source tree.
#   cmake -DLAMINA_BUILD=... -DLAMINA_SOURCE=... -DSCRATCH=... -DGENERATOR=... -DCXX=... -P consumer_test.cmake

function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE out ERROR_VARIABLE out)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${ARGN}: ${result}\n${out}")
  endif()
  set(output "${out}" PARENT_SCOPE)
endfunction()

set(consumer ${LAMINA_SOURCE}/tests/consumer)
set(configure ${CMAKE_COMMAND} -S ${consumer} -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${CXX}
  -DCMAKE_BUILD_TYPE=Release "-DCMAKE_CXX_FLAGS=${FLAGS}")
file(REMOVE_RECURSE ${SCRATCH})
run(${CMAKE_COMMAND} --install ${LAMINA_BUILD} --prefix ${SCRATCH}/prefix)

run(${configure} -B ${SCRATCH}/installed -DCMAKE_PREFIX_PATH=${SCRATCH}/prefix -DCONFIGURED=ON)
run(${CMAKE_COMMAND} --build ${SCRATCH}/installed)
run(${SCRATCH}/installed/consumer)
if(NOT output MATCHES "scan 19: tracked, x 1\\.9[0-9]+ m|scan 19: tracked, x 1\\.89[0-9]* m")
  message(FATAL_ERROR "the consumer's poses are wrong:\n${output}")
endif()
if(NOT output MATCHES "[1-9][0-9]+ surfels")
  message(FATAL_ERROR "the consumer's map is empty:\n${output}")
endif()

run(${SCRATCH}/installed/configured)
if(NOT output MATCHES "voxels of 2.0 m, halved 2 times; 3 scans")
  message(FATAL_ERROR "the shipped configuration is not what was asked for:\n${output}")
endif()

# No external library of the program, and no flag of ours, comes with the algorithms.
run(${configure} -B ${SCRATCH}/inside -DLAMINA_SOURCE=${LAMINA_SOURCE}
  -DCMAKE_EXPORT_COMPILE_COMMANDS=ON)
file(READ ${SCRATCH}/inside/compile_commands.json commands)
foreach(word Werror yaml-cpp SQLite pcl cmake_pch Unity)
  if(commands MATCHES "${word}")
    message(FATAL_ERROR "as a part of another project: ${word} in\n${commands}")
  endif()
endforeach()

# An option that is off takes with it what needs it, and contradicts what is asked for.
set(alone ${CMAKE_COMMAND} -S ${LAMINA_SOURCE} -G ${GENERATOR} -DCMAKE_CXX_COMPILER=${CXX})
foreach(option IO PROGRAM LAB)
  run(${alone} -B ${SCRATCH}/without_${option} -DLAMINA_BUILD_${option}=OFF)
endforeach()
execute_process(COMMAND ${alone} -B ${SCRATCH}/contradiction -DLAMINA_BUILD_LAB=OFF
  -DLAMINA_BUILD_TESTS=ON RESULT_VARIABLE result OUTPUT_QUIET ERROR_VARIABLE said)
if(result EQUAL 0 OR NOT said MATCHES "LAMINA_BUILD_TESTS=ON needs LAMINA_BUILD_LAB=ON")
  message(FATAL_ERROR "tests without the laboratory: ${result}\n${said}")
endif()
