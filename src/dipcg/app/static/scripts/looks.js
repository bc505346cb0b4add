// How the asset is coloured: with the materials of its file, with colours of the photo, or with one colour for each part.
import { Color, MeshStandardMaterial } from "../vendor/three.js";

// One colour for each part, as the pictures of the candidates have them (PALETTE of render.py).
const PALETTE = [[0.76, 0.6, 0.42], [0.45, 0.58, 0.66], [0.66, 0.45, 0.4], [0.55, 0.65, 0.45], [0.62, 0.55, 0.7], [0.8, 0.72, 0.5]];

/** Paint a loaded GLB as `colours` of the state says; the materials of the file are kept beside. */
export function paint(asset, { colours, open, results }) {
  const photo = results[open?.result]?.candidates[Math.max(open.chosen, 0)]?.colours;
  const parts = new Map();
  asset.traverse((node) => {
    if (!node.isMesh) return;
    node.userData.own ??= node.material;
    const part = partOf(node);
    if (!parts.has(part)) parts.set(part, parts.size);
    if (colours === "parts") node.material = plain(node.userData.own, PALETTE[parts.get(part) % PALETTE.length]);
    else if (colours === "photo" && photo?.[part]) node.material = plain(node.userData.own, photo[part]);
    else node.material = node.userData.own;
  });
}

/** The name of a part, which its mesh or the node above it has; three.js adds a number to names that occur twice. */
const partOf = (node) => (node.geometry.name || node.name || node.parent.name).replace(/_\d+$/, "");

function plain(own, [red, green, blue]) {
  const { roughness, metalness } = own;
  return new MeshStandardMaterial({ color: new Color().setRGB(red, green, blue, "srgb"), roughness, metalness, side: own.side });
}
