import type { Problem } from "../documents";
import { ApiError } from "../api";
import { t } from "../language/catalogue";

/** What went wrong, and what to do about it. */
export function ProblemNote({ problem, retry }: { problem: Problem; retry?: () => void }) {
  return (
    <div class="note bad stack" role="alert">
      <p>
        <strong>{problem.detail}</strong>
      </p>
      {problem.remedy && <p>{problem.remedy}</p>}
      {retry && (
        <p>
          <button type="button" onClick={retry}>
            {t("Try again")}
          </button>
        </p>
      )}
    </div>
  );
}

/** The problem of an error; one that is not the service's is a fault of the page and is raised again. */
export function problemOf(error: unknown): Problem {
  if (error instanceof ApiError) return error.problem;
  throw error;
}
