// How the asset is coloured: with the materials of its file, with colours of the photo, or with one colour for each part.
import { Color, MeshStandardMaterial } from "../vendor/three.js";

// One colour for each part, as the pictures of the candidates have them (PALETTE of render.py).
const PALETTE = [[0.76, 0.6, 0.42], [0.45, 0.58, 0.66], [0.66, 0.45, 0.4], [0.55, 0.65, 0.45], [0.62, 0.55, 0.7], [0.8, 0.72, 0.5]];

/** Paint a loaded GLB as `colours` of the state says; the materials of the file are kept beside. */
export function paint(asset, now) {
  const colours = look(now), photo = photoColours(now), parts = new Map();
  asset.traverse((node) => {
    if (!node.isMesh) return;
    node.userData.own ??= node.material;
    const part = partOf(node, asset);
    if (!parts.has(part)) parts.set(part, painted(node.userData.own, colours, PALETTE[parts.size % PALETTE.length], photo?.[part]));
    node.material = parts.get(part) ?? node.userData.own;
  });
}

/** The colours of the photo on the parts of the open asset; none without a photo that shows any. */
export const photoColours = ({ open, results }) => results[open?.result]?.candidates[Math.max(open.chosen, 0)]?.colours ?? {};

/** The look that the visitor chose; that of materials where there are no colours of a photo. */
export const look = (now) => (now.colours === "photo" && !Object.keys(photoColours(now)).length ? "materials" : now.colours);

/** The name of a part: of the node below the root of the file. Copies of a shape lie deeper. */
function partOf(node, asset) {
  const root = asset.children[0];
  while (node.parent !== root && node.parent !== asset && node.parent) node = node.parent;
  // The loader changes the names of its own objects, and keeps that of the file here.
  return node.userData.name ?? node.name;
}

/** The material of a part; null for that of its file. */
function painted(own, colours, partColour, photoColour) {
  const colour = { parts: partColour, photo: photoColour }[colours];
  if (!colour) return null;
  const { roughness, side } = own;
  return new MeshStandardMaterial({ color: new Color().setRGB(...colour, "srgb"), roughness, side });
}
