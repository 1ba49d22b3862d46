/** Files dragged over the page, wherever that is. */

export interface DropTarget {
  /** Files are over the page, or no longer. */
  over(isOver: boolean): void;
  drop(files: readonly File[]): void;
}

export function listenForDrops(target: DropTarget): () => void {
  // The pointer enters a child before it leaves the parent, so that only the count says whether it is outside.
  let depth = 0;
  const hasFiles = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;
  const enter = (event: DragEvent): void => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    depth += 1;
    if (depth === 1) target.over(true);
  };
  const leave = (event: DragEvent): void => {
    if (!hasFiles(event)) return;
    depth = Math.max(0, depth - 1);
    if (depth === 0) target.over(false);
  };
  const over = (event: DragEvent): void => {
    if (hasFiles(event)) event.preventDefault();
  };
  const drop = (event: DragEvent): void => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    depth = 0;
    target.over(false);
    target.drop([...(event.dataTransfer?.files ?? [])]);
  };
  const heard = { dragenter: enter, dragleave: leave, dragover: over, drop };
  for (const [name, listener] of Object.entries(heard))
    document.addEventListener(name, listener as EventListener);
  return () => {
    for (const [name, listener] of Object.entries(heard))
      document.removeEventListener(name, listener as EventListener);
  };
}
