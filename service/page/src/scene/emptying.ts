import { Mesh, type Group, type Material, type Object3D } from "three";

/** Takes all out of a group and gives back what it held on the graphics card. */
export function empty(group: Group): void {
  const held = [...group.children];
  group.clear();
  for (const child of held) {
    child.traverse((each: Object3D) => {
      if (!(each instanceof Mesh)) return;
      each.geometry.dispose();
      for (const material of [each.material as Material | Material[]].flat()) {
        (material as Material & { alphaMap?: { dispose(): void } | null }).alphaMap?.dispose();
        material.dispose();
      }
    });
  }
}
