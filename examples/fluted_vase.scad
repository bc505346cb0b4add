// A vase with flutes that turn around it, in the words of OpenSCAD's Customizer.

/* [Body] */
// Height of the vase
height = 120; // [60:200]
// Radius at the foot
foot = 25; // [15:0.5:40]
// Radius at the mouth
mouth = 35; // [15:0.5:50]
// Turn of the flutes from foot to mouth
twist = 40; // [-90:90]

/* [Outline] */
// Shape seen from above
outline = "round"; // [round, square, star]
// Number of points of the star
points = 6; // [4:10]
// Depth of the points, as a share of the radius
depth = 0.3; // [0.1:0.05:0.5]

/* [Rim] */
// A ring around the mouth
has_rim = true;
// Thickness of the ring
rim = 4; // [2:0.5:8]

/* [Hidden] */
$fn = 48;

module shape(radius) {
    if (outline == "square") square(1.6 * radius, center = true);
    else if (outline == "star") polygon([for (i = [0 : 2 * points - 1])
        let (r = radius * (i % 2 == 0 ? 1 : 1 - depth)) r * [cos(180 * i / points), sin(180 * i / points)]]);
    else circle(radius);
}

linear_extrude(height, scale = mouth / foot, twist = twist, slices = 24) shape(foot);
if (has_rim) translate([0, 0, height]) rotate_extrude() translate([mouth, 0]) circle(rim / 2, $fn = 16);
