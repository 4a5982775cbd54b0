/* m4gn.h is plain C, and a C program can ask for the version and be told what is wrong. */

#include "m4gn.h"

#include <stdio.h>
#include <string.h>

int main(void)
{
    int place = 0;
    m4gn_session* session = (m4gn_session*)&place;
    int failed = 0;

    failed += m4gn_abi_version() != M4GN_ABI_VERSION;
    failed += strlen(m4gn_version()) < 5;
    failed += strlen(m4gn_last_error()) != 0;

    failed += m4gn_options_check("session", NULL) != M4GN_OK;
    failed += m4gn_options_check("session", "{\"segmnets\": {}}") != M4GN_ERROR_INPUT;
    failed += strstr(m4gn_last_error(), "segmnets: unknown entry") == NULL;

    failed += m4gn_session_new(M4GN_NO_MPI, NULL, NULL, "{}", NULL, &session) != M4GN_ERROR_INPUT;
    failed += session != NULL;
    failed += strstr(m4gn_last_error(), "mesh") == NULL;

    m4gn_session_free(NULL);
    m4gn_recorder_free(NULL);

    if (failed)
    {
        fprintf(stderr, "%d checks failed; last error: %s\n", failed, m4gn_last_error());
    }
    return failed != 0;
}
